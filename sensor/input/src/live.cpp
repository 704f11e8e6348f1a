#include "pecs/input/live.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/highgui.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "linear.h"
#include "pecs/error.h"
#include "pecs/events/format.h"
#include "pecs/files.h"
#include "pecs/sensor/photocurrent.h"
#include "pecs/sensor/sensor.h"

namespace pecs::input {
namespace {

using Clock = std::chrono::steady_clock;

double microseconds_since(Clock::time_point start) {
  return std::chrono::duration<double, std::micro>(Clock::now() - start).count();
}

// Whether a window opens. Some toolkits end the program where a display does not answer: so another process tries.
bool display_answers() {
  if (!std::getenv("DISPLAY") && !std::getenv("WAYLAND_DISPLAY")) return false;
  const pid_t child = ::fork();
  if (child == 0) {
    ::alarm(10);  // seconds
    if (const int null = ::open("/dev/null", O_WRONLY); null >= 0) ::dup2(null, STDERR_FILENO);
    try {
      cv::namedWindow("events");
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
  EventView(const LiveOptions& live, cv::Size size, bool shows)
      : live_(live), picture_(size, CV_8UC3, kPaper), shows_(shows) {
    if (shows_) {
      cv::namedWindow("events", cv::WINDOW_AUTOSIZE | cv::WINDOW_GUI_NORMAL);  // without a toolbar
      return;
    }
    partial_.emplace(live.video);
    // FFmpeg knows a container by its ending.
    unfinished_ = live.video.parent_path() / ("." + live.video.stem().string() + ".partial.mp4");
    if (!writer_.open(unfinished_.string(), cv::CAP_FFMPEG, cv::VideoWriter::fourcc('m', 'p', '4', 'v'), 30, size))
      throw bad_output(live.video.string(), "OpenCV has no MPEG-4 encoder");
  }

  // Events before `until_us` are complete. False when the user has had enough.
  bool add(std::span<const events::Event> events, std::int64_t until_us) {
    bool goes_on = true;
    for (const events::Event& e : events) {
      while (e.t_us >= next_us_) goes_on &= flush();
      picture_.at<cv::Vec3b>(e.y, e.x) = e.p ? cv::Vec3b(178, 114, 0) : cv::Vec3b(0, 94, 213);
    }
    while (until_us >= next_us_) goes_on &= flush();
    return goes_on;
  }
  void close() {
    flush();
    if (shows_) return;
    writer_.release();
    partial_->commit(unfinished_);
  }

 private:
  bool flush() {
    next_us_ += live_.picture_us;
    int key = -1;
    if (shows_) {
      cv::imshow("events", picture_);
      const double early_us = static_cast<double>(next_us_ - live_.picture_us) - microseconds_since(start_);
      key = cv::waitKey(std::clamp(static_cast<int>(early_us * 1e-3), 1, 1000));
    } else {
      writer_.write(picture_);
    }
    picture_.setTo(kPaper);
    return key != 27;
  }

  static inline const cv::Scalar kPaper{255, 255, 255};
  const LiveOptions& live_;
  cv::Mat picture_;
  cv::VideoWriter writer_;
  std::optional<PartialFile> partial_;
  std::filesystem::path unfinished_;
  bool shows_;
  Clock::time_point start_ = Clock::now();
  std::int64_t next_us_ = live_.picture_us;
};

cv::VideoCapture open_source(const LiveOptions& live) {
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);  // what fails is said below
  cv::VideoCapture capture;
  if (live.camera && !capture.open(*live.camera))
    throw not_found(fmt::format("camera {}", *live.camera), "no such camera");
  if (!live.camera && !std::filesystem::exists(live.file)) throw not_found(live.file.string(), "no such file");
  if (!live.camera && !capture.open(live.file.string()))
    throw bad_input(live.file.string(), "", "nothing that OpenCV can read", "a video");
  return capture;
}

}  // namespace

sensor::SenseReport sense_live(const LiveOptions& live, const sensor::SenseOptions& sense,
                               const PictureOptions& pictures) {
  const bool camera = live.camera.has_value();
  const std::string name = camera ? fmt::format("camera {}", *live.camera) : live.file.string();
  const bool shows = display_answers();
  cv::VideoCapture capture = open_source(live);
  if (camera && !shows && !live.seconds)
    throw Error(ExitCode::usage, name + ": got no display to stop it at, wanted --seconds");
  const Linear linear(pictures);
  cv::Mat frame;
  if (!capture.read(frame)) throw bad_input(name, "", "no frame", "a video");

  const sensor::Chip given = sensor::load_chip(sense.chip, sense.overrides);
  const sensor::Chip chip = sense.no_noise ? without_noise(given) : given;
  sensor::StackInfo info;
  info.quantity = sensor::Quantity::relative;
  info.width = frame.cols;
  info.height = frame.rows;
  info.bands = linear.bands_of(frame);
  const std::vector<double> amperes = amperes_per_unit(chip, info, sense.light);
  sensor::ModelChoice model = sense.model;
  if (model.white_fa == 0) model.white_fa = sense.light.photocurrent_a.value_or(sensor::kDefaultWhite_a) * 1e15;
  sensor::Sensor sensor(chip, info.width, info.height, sense.seed, 1.0, model, {!sense.ideal_readout, false});
  const auto writer = events::open_writer(sense.output, {info.width, info.height, chip.name}, sense.format);
  EventView view(live, frame.size(), shows);

  const double rate = pictures.times.fps.value_or(capture.get(cv::CAP_PROP_FPS));
  if (!camera && !(rate > 0)) throw bad_input(name, "times", "none", "--fps");
  const auto start = Clock::now();
  const std::size_t pixels = frame.total();
  std::vector<float> plane(pixels);
  std::int64_t frames = 0, count = 0;
  double t_us = 0;
  bool last = false;
  sensor::LabelledEvents found;
  while (!last) {
    const std::vector<float> values = linear(frame);
    std::ranges::fill(plane, 0.0f);
    for (std::size_t b = 0; b < amperes.size(); ++b)
      for (std::size_t i = 0; i < pixels; ++i)
        plane[i] += static_cast<float>(amperes[b] * 1e15) * values[b * pixels + i];
    const double now_us = t_us;
    ++frames;
    last = !capture.read(frame) || (live.seconds && now_us >= *live.seconds * 1e6);
    t_us = camera ? std::max(microseconds_since(start), t_us + 1) : static_cast<double>(frames) * 1e6 / rate;

    const float* pointer = plane.data();
    found.events.clear();
    sensor.push({&pointer, 1}, {&now_us, 1}, last, found);
    writer->write(found.events);
    count += static_cast<std::int64_t>(found.events.size());
    if (!view.add(found.events, 0)) last = true;
    if (!last && (frame.cols != info.width || frame.rows != info.height))
      throw bad_input(name, fmt::format("frame {}", frames), fmt::format("{}x{}", frame.cols, frame.rows),
                      fmt::format("{}x{} as the first", info.width, info.height));
  }
  view.close();
  writer->close();
  const double seconds = microseconds_since(start) * 1e-6;
  sensor::SenseReport report;
  report.config = {{"chip", sensor::chip_to_json(chip)},
                   {"model", sensor::model_to_json(model)},
                   {"seed", sense.seed},
                   {"input", camera ? "camera" : "video"},
                   {"view", shows ? "window" : live.video.string()}};
  report.results = {
      {"width", info.width}, {"height", info.height},       {"frames", frames},
      {"events", count},     {"dropped", sensor.dropped()}, {"frames_per_s", static_cast<double>(frames) / seconds}};
  return report;
}

}  // namespace pecs::input
