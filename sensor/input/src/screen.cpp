#include "pecs/input/screen.h"

#include <chrono>
#include <cstdlib>
#include <opencv2/imgproc.hpp>

#include "pecs/events/picture.h"
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

class EventView {
 public:
  EventView(const Screen& screen, cv::Size size, bool shows) : screen_(screen), size_(size) {
    if (shows)
      media().open_window(kWindow);
    else
      video_.emplace(screen.video, 30);
  }

  // False when the user ends the view.
  bool add(std::span<const events::Event> events) {
    if (events.empty() && !video_) return media().show(kWindow, picture(), 1) != kEscape;
    bool goes_on = true;
    for (const events::Event& e : events) {
      while (e.t_us >= next_us_) goes_on &= flush();
      now_.push_back(e);
    }
    return goes_on;
  }
  void close() {
    flush();
    if (video_) video_->close();
  }

 private:
  cv::Mat picture() const {
    auto pixels = events::picture(now_, size_.width, size_.height, events::kLight);
    cv::Mat bgr;
    cv::cvtColor(cv::Mat(size_, CV_8UC3, pixels.data()), bgr, cv::COLOR_RGB2BGR);
    return bgr;
  }
  bool flush() {
    next_us_ += screen_.picture_us;
    int key = -1;
    if (video_) {
      video_->write(picture());
    } else {
      const double early_us = static_cast<double>(next_us_ - screen_.picture_us) - microseconds_since(start_);
      key = media().show(kWindow, picture(), std::clamp(static_cast<int>(early_us * 1e-3), 1, 1000));
    }
    now_.clear();
    return key != kEscape;
  }

  static constexpr int kEscape = 27;
  const Screen& screen_;
  cv::Size size_;
  std::vector<events::Event> now_;  // of the next picture
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
