#include "pecs/input/screen.h"

#include <chrono>
#include <cstdlib>
#include <opencv2/imgproc.hpp>

#include "pecs/input/media.h"
#include "pecs/input/video_file.h"
#include "pecs/platform.h"

namespace pecs::input {
namespace {

using Clock = std::chrono::steady_clock;

constexpr const char* kWindow = "events";

double microseconds_since(Clock::time_point start) {
  return std::chrono::duration<double, std::micro>(Clock::now() - start).count();
}

// True if a window opens. Some toolkits end the program if the display does not answer, so a child process tries.
bool display_answers() {
  if (!std::getenv("DISPLAY") && !std::getenv("WAYLAND_DISPLAY")) return false;
  const Media& opencv = media();  // loaded once, for the child as well
  return platform::succeeds_in_child([&] { opencv.open_window(kWindow); }, 10);
}

// ON blue, OFF orange on white (Okabe and Ito, 2008).
class EventView {
 public:
  EventView(const Screen& screen, cv::Size size, bool shows) : screen_(screen), picture_(size, CV_8UC3, kPaper) {
    if (shows)
      media().open_window(kWindow);
    else
      video_.emplace(screen.video, 30);
  }

  // False when the user ends the view.
  bool add(std::span<const events::Event> events) {
    if (events.empty() && !video_) return media().show(kWindow, picture_, 1) != kEscape;
    bool goes_on = true;
    for (const events::Event& e : events) {
      while (e.t_us >= next_us_) goes_on &= flush();
      picture_.at<cv::Vec3b>(e.y, e.x) = e.p ? cv::Vec3b(178, 114, 0) : cv::Vec3b(0, 94, 213);
    }
    return goes_on;
  }
  void close() {
    flush();
    if (video_) video_->close();
  }

 private:
  bool flush() {
    next_us_ += screen_.picture_us;
    int key = -1;
    if (video_) {
      video_->write(picture_);
    } else {
      const double early_us = static_cast<double>(next_us_ - screen_.picture_us) - microseconds_since(start_);
      key = media().show(kWindow, picture_, std::clamp(static_cast<int>(early_us * 1e-3), 1, 1000));
    }
    picture_.setTo(kPaper);
    return key != kEscape;
  }

  static constexpr int kEscape = 27;
  static inline const cv::Scalar kPaper{255, 255, 255};
  const Screen& screen_;
  cv::Mat picture_;
  std::optional<VideoFile> video_;  // none: the window
  Clock::time_point start_ = Clock::now();
  std::int64_t next_us_ = screen_.picture_us;
};

}  // namespace

sensor::SenseReport sense_on_screen(const Screen& screen, sensor::SenseOptions options) {
  const bool shows = display_answers();
  EventView view(screen, {options.source->info().width, options.source->info().height}, shows);
  options.watch = [&](std::span<const events::Event> events) { return view.add(events); };
  sensor::SenseReport report = sensor::sense(options);
  view.close();
  report.config["view"] = shows ? "window" : screen.video.string();
  return report;
}

}  // namespace pecs::input
