#pragma once
// Pictures, videos and windows of OpenCV, in a library that is loaded when the first one is used: Debian's OpenCV needs
// 200 libraries for them, and loading those takes longer than most commands.
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace cv {
class Mat;
}

namespace pecs::input {

struct VideoFrames {
  std::function<bool(cv::Mat&)> read;  // the next frame; false at the end. Empty: nothing that OpenCV can read.
  double fps = 0;                      // nominal; 0: unknown
  double pixel_aspect = 1;             // width of a pixel over its height
};

struct VideoIndex {
  std::vector<double> times_ms;  // of all frames that can be decoded, in the order of display; NaN: the file has none
  int transfer = 2, matrix = 2;  // transfer curve and matrix of ITU-T H.273; 2: not stated
  bool interlaced = false;
  bool misread_range = false;  // YUV of full range, of a kind that OpenCV reads as limited range
};

struct Media {
  cv::Mat (*read_picture)(const std::string& path, int imread_flags);  // empty where OpenCV cannot read it
  std::vector<std::uint8_t> (*png_of)(const cv::Mat& picture);
  VideoFrames (*open_video)(const std::string& path);
  VideoIndex (*index_video)(const std::string& path);  // empty: no video that FFmpeg can read
  // Appends frames; its end closes the file. codec: FOURCC; empty where no such encoder opens.
  std::function<void(const cv::Mat&)> (*video_writer)(const std::string& path, const std::string& codec, double fps,
                                                      int width, int height);
  // Dense optical flow (DIS, Kroeger et al., ECCV 2016) between two pictures of 8 bits, grey: [px], from the pixels of
  // the first, float x and y.
  cv::Mat (*optical_flow)(const cv::Mat& from, const cv::Mat& to);
  void (*open_window)(const char* name);
  int (*show)(const char* window, const cv::Mat& picture, int wait_ms);  // the key that was pressed, or -1
};

const Media& media();  // throws internal if the library is missing

}  // namespace pecs::input
