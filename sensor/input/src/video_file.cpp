#include "pecs/input/video_file.h"

#include <fmt/format.h>

#include <opencv2/core.hpp>

#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/input/media.h"

namespace pecs::input {

struct VideoFile::State {
  std::filesystem::path path;
  double fps;
  PartialFile partial{path, true};
  std::function<void(const cv::Mat&)> append{};
  std::string codec{};
  cv::Size size{};
  std::size_t frames = 0;
};

VideoFile::VideoFile(const std::filesystem::path& path, double fps) : state_(new State{path, fps}) {}

VideoFile::~VideoFile() = default;

void VideoFile::write(const cv::Mat& bgr) {
  cv::Mat even;  // the encoders halve the resolution of colour
  cv::copyMakeBorder(bgr, even, 0, bgr.rows % 2, 0, bgr.cols % 2, cv::BORDER_REPLICATE);
  State& s = *state_;
  for (const char* codec : {"avc1", "mp4v"}) {
    if (s.append) break;
    s.codec = codec;
    s.size = even.size();
    s.append = media().video_writer(s.partial.partial_path().string(), codec, s.fps, even.cols, even.rows);
  }
  if (!s.append)
    throw bad_output(s.path.string(),
                     fmt::format("no video encoder could be opened for {}x{} at {:g} Hz (disk, FFmpeg?)", even.cols,
                                 even.rows, s.fps));
  s.append(even);
  ++s.frames;
}

void VideoFile::close() {
  State& s = *state_;
  s.append = {};
  // OpenCV reports neither a full disk nor a frame that the encoder rejects.
  const std::string written = s.partial.partial_path().string();
  const VideoFrames video = media().open_video(written);
  cv::Mat first;
  if (video.read) video.read(first);
  const std::size_t frames = media().index_video(written).times_ms.size();
  if (first.size() != s.size || frames != s.frames)
    throw bad_output(s.path.string(),
                     fmt::format("got {} readable frames of {}x{}, wanted {} of {}x{} (disk full?)", frames, first.cols,
                                 first.rows, s.frames, s.size.width, s.size.height));
  s.partial.commit();
}

const std::string& VideoFile::codec() const { return state_->codec; }

}  // namespace pecs::input
