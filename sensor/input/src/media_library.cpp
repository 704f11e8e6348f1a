#include <opencv2/highgui.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>

#include "pecs/input/media.h"

namespace pecs::input {
namespace {

cv::Mat read_picture(const std::string& path, int imread_flags) {
  try {
    return cv::imread(path, imread_flags);
  } catch (const cv::Exception&) {
    return {};
  }
}

std::vector<std::uint8_t> png_of(const cv::Mat& picture) {
  std::vector<std::uint8_t> png;
  cv::imencode(".png", picture, png);
  return png;
}

std::unique_ptr<cv::VideoCapture> video_reader() { return std::make_unique<cv::VideoCapture>(); }

std::unique_ptr<cv::VideoWriter> video_writer(const std::string& path, const std::string& codec, double fps, int width,
                                              int height) {
  const int fourcc = cv::VideoWriter::fourcc(codec.at(0), codec.at(1), codec.at(2), codec.at(3));
  auto writer = std::make_unique<cv::VideoWriter>(path, cv::CAP_FFMPEG, fourcc, fps, cv::Size(width, height));
  return writer->isOpened() ? std::move(writer) : nullptr;
}

void open_window(const char* name) { cv::namedWindow(name, cv::WINDOW_AUTOSIZE | cv::WINDOW_GUI_NORMAL); }

int show(const char* window, const cv::Mat& picture, int wait_ms) {
  cv::imshow(window, picture);
  return cv::waitKey(wait_ms);
}

}  // namespace
}  // namespace pecs::input

extern "C" __attribute__((visibility("default")))
const pecs::input::Media pecs_media{pecs::input::read_picture, pecs::input::png_of,      pecs::input::video_reader,
                                    pecs::input::video_writer, pecs::input::open_window, pecs::input::show};
