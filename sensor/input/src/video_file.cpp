#include "pecs/input/video_file.h"

#include <opencv2/core.hpp>

#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/input/media.h"

namespace pecs::input {

struct VideoFile::State {
  std::filesystem::path path, unfinished;  // OpenCV chooses the container by the extension, so both have the same one
  double fps;
  PartialFile partial;
  std::function<void(const cv::Mat&)> append;
  std::string codec;
};

VideoFile::VideoFile(const std::filesystem::path& path, double fps)
    : state_(new State{path,
                       path.parent_path() / ("." + path.stem().string() + ".partial" + path.extension().string()),
                       fps,
                       PartialFile(path),
                       {},
                       {}}) {}

VideoFile::~VideoFile() = default;

void VideoFile::write(const cv::Mat& bgr) {
  const cv::Rect even(0, 0, bgr.cols / 2 * 2, bgr.rows / 2 * 2);
  State& s = *state_;
  for (const char* codec : {"avc1", "mp4v"}) {
    if (s.append) break;
    s.codec = codec;
    s.append = media().video_writer(s.unfinished.string(), codec, s.fps, even.width, even.height);
  }
  if (!s.append) throw bad_output(s.path.string(), "no video encoder could be opened (disk, FFmpeg?)");
  s.append(bgr(even));
}

void VideoFile::close() {
  state_->append = {};
  state_->partial.commit(state_->unfinished);
}

const std::string& VideoFile::codec() const { return state_->codec; }

}  // namespace pecs::input
