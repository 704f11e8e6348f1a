#include "pecs/input/live.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <opencv2/imgproc.hpp>

#include "linear.h"
#include "pecs/error.h"
#include "pecs/input/media.h"
#include "pecs/input/video_file.h"
#include "pecs/sensor/photocurrent.h"

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
  const pid_t child = ::fork();
  if (child == 0) {
    ::alarm(10);  // seconds
    if (const int null = ::open("/dev/null", O_WRONLY); null >= 0) ::dup2(null, STDERR_FILENO);
    try {
      opencv.open_window(kWindow);
    } catch (...) {
      ::_exit(1);
    }
    ::_exit(0);
  }
  int status = 1;
  return child > 0 && ::waitpid(child, &status, 0) == child && status == 0;
}

// ON blue, OFF orange on white (Okabe and Ito, 2008).
class EventView {
 public:
  EventView(const LiveOptions& live, cv::Size size, bool shows) : live_(live), picture_(size, CV_8UC3, kPaper) {
    if (shows)
      media().open_window(kWindow);
    else
      video_.emplace(live.video, 30);
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
    next_us_ += live_.picture_us;
    int key = -1;
    if (video_) {
      video_->write(picture_);
    } else {
      const double early_us = static_cast<double>(next_us_ - live_.picture_us) - microseconds_since(start_);
      key = media().show(kWindow, picture_, std::clamp(static_cast<int>(early_us * 1e-3), 1, 1000));
    }
    picture_.setTo(kPaper);
    return key != kEscape;
  }

  static constexpr int kEscape = 27;
  static inline const cv::Scalar kPaper{255, 255, 255};
  const LiveOptions& live_;
  cv::Mat picture_;
  std::optional<VideoFile> video_;  // none: the window
  Clock::time_point start_ = Clock::now();
  std::int64_t next_us_ = live_.picture_us;
};

VideoFrames open_source(const LiveOptions& live) {
  if (!live.camera && !std::filesystem::exists(live.file)) throw not_found(live.file.string(), "no such file");
  VideoFrames frames = live.camera ? media().open_camera(*live.camera) : media().open_video(live.file.string());
  if (!frames.read && live.camera) throw not_found(fmt::format("camera {}", *live.camera), "no such camera");
  if (!frames.read) throw bad_input(live.file.string(), "", "nothing that OpenCV can read", "a video");
  return frames;
}

// Live frames, with the time of arrival (camera), or the file's frame rate or frames' own times (video).
class Live final : public sensor::FrameSource {
 public:
  Live(const LiveOptions& live, const PictureOptions& pictures)
      : live_(live), linear_(pictures), video_(open_source(live)) {
    if (!video_.read(frame_)) throw bad_input(name(), "", "no frame", "a video");
    info_.quantity = sensor::Quantity::relative;
    info_.width = frame_.cols;
    info_.height = frame_.rows;
    info_.bands = linear_.bands_of(frame_);
    rate_hz_ = pictures.times.fps.value_or(video_.fps);
    rate_is_stated_ = pictures.times.fps.has_value();
    if (!live.camera && !(rate_hz_ > 0)) throw bad_input(name(), "times", "none", "--fps");
    if (!live.camera) check_pixel_aspect(video_, name());
    first_ms_ = video_.time_ms();
  }
  const sensor::StackInfo& info() const override { return info_; }
  std::int64_t frames() const override { return frames_; }
  std::string name() const override {
    return live_.camera ? fmt::format("camera {}", *live_.camera) : live_.file.string();
  }
  std::string layout() const override { return live_.camera ? "camera" : "video"; }
  bool is_live() const override { return true; }

  std::optional<double> next_us() override {
    const bool enough = frames_ > 0 && live_.seconds && t_us_ >= *live_.seconds * 1e6;
    if (enough || (frames_ > 0 && !video_.read(frame_))) return {};
    if (frame_.cols != info_.width || frame_.rows != info_.height)
      throw bad_input(name(), fmt::format("frame {}", frames_), fmt::format("{}x{}", frame_.cols, frame_.rows),
                      fmt::format("{}x{} as the first", info_.width, info_.height));
    if (frames_ == 0) start_ = Clock::now();
    const double own_ms = live_.camera ? 0 : video_.time_ms() - first_ms_;
    const bool nominal = rate_is_stated_ || is_nominal(own_ms, frames_, rate_hz_);
    const double file_us = nominal ? static_cast<double>(frames_) * 1e6 / rate_hz_ : own_ms * 1e3;
    t_us_ = frames_ == 0 ? 0 : std::max(live_.camera ? microseconds_since(start_) : file_us, t_us_ + 1);
    ++frames_;
    return t_us_;
  }
  void read_rows(std::int64_t, const sensor::RowSink& sink, int begin, int end) const override {
    if (end == 0) end = info_.height;
    sink(begin, end - begin, linear_(frame_.rowRange(begin, end)));
  }

 private:
  const LiveOptions& live_;
  Linear linear_;
  VideoFrames video_;
  cv::Mat frame_;
  sensor::StackInfo info_;
  double rate_hz_ = 0, t_us_ = 0, first_ms_ = 0;
  bool rate_is_stated_ = false;
  std::int64_t frames_ = 0;
  Clock::time_point start_;
};

}  // namespace

sensor::SenseReport sense_live(const LiveOptions& live, sensor::SenseOptions sense, const PictureOptions& pictures) {
  const bool shows = display_answers();
  if (live.camera && !shows && !live.seconds)
    throw Error(ExitCode::usage,
                fmt::format("camera {}: got no display to stop it at, wanted --run-time", *live.camera));
  if (pictures.times.file_us) throw Error(ExitCode::usage, "--times: got --view, wanted a file's frames");
  if (live.camera && pictures.times.fps)
    throw Error(ExitCode::usage, "--fps: got a camera, whose frames have the times of their arrival, wanted a video");
  const auto source = std::make_shared<Live>(live, pictures);
  if (sense.model.white_fa == 0 &&
      !sensor::model_traits(sense.model.name).takes_light)  // white is the same in all frames
    sense.model.white_fa = sense.light.photocurrent_a.value_or(sensor::kDefaultWhite_a) * 1e15;
  EventView view(live, {source->info().width, source->info().height}, shows);
  sense.source = source;
  sense.watch = [&](std::span<const events::Event> events) { return view.add(events); };
  const auto start = Clock::now();
  sensor::SenseReport report = sensor::sense(sense);
  view.close();
  report.config["view"] = shows ? "window" : live.video.string();
  report.results["frames_per_s"] = static_cast<double>(source->frames()) / (microseconds_since(start) * 1e-6);
  return report;
}

}  // namespace pecs::input
