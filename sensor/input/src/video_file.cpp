#include "pecs/input/video_file.h"

#include <opencv2/videoio.hpp>

#include "pecs/error.h"
#include "pecs/files.h"

namespace pecs::input {

struct VideoFile::State {
  std::filesystem::path path, unfinished;  // OpenCV chooses the container by the extension, so both have the same one
  double fps;
  PartialFile partial;
  cv::VideoWriter writer;
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
    if (s.writer.isOpened()) break;
    s.codec = codec;
    s.writer.open(s.unfinished.string(), cv::CAP_FFMPEG,
                  cv::VideoWriter::fourcc(codec[0], codec[1], codec[2], codec[3]), s.fps, even.size());
  }
  if (!s.writer.isOpened()) throw bad_output(s.path.string(), "no video encoder could be opened (disk, FFmpeg?)");
  s.writer.write(bgr(even));
}

void VideoFile::close() {
  state_->writer.release();
  state_->partial.commit(state_->unfinished);
}

const std::string& VideoFile::codec() const { return state_->codec; }

}  // namespace pecs::input
