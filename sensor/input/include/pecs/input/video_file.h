#pragma once
// Video files (H.264, or MPEG-4 where OpenCV's FFmpeg has no such encoder), whole or not at all.
#include <filesystem>
#include <memory>
#include <string>

namespace cv {
class Mat;
}

namespace pecs::input {

class VideoFile {
 public:
  // path: its extension chooses the container. The file is replaced by close(); until then it is a .partial file.
  VideoFile(const std::filesystem::path& path, double fps);
  ~VideoFile();

  // bgr: 8 bits; an odd last row or column is left out, as H.264 requires. Throws bad_output where no encoder opens.
  void write(const cv::Mat& bgr);
  void close();                      // throws bad_output unless all frames can be read back
  const std::string& codec() const;  // FOURCC, after the first frame

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace pecs::input
