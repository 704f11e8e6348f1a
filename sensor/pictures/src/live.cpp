#include "pecs/sensor/live.h"

#include <fmt/format.h>

#include <charconv>
#include <chrono>
#include <cstdlib>
#include <opencv2/highgui.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "linear.h"
#include "pecs/error.h"
#include "pecs/events/format.h"
#include "pecs/files.h"
#include "pecs/sensor/light.h"
#include "pecs/sensor/sensor.h"

namespace pecs::sensor {
namespace {

// ON blue, OFF orange on white (Okabe and Ito, 2008).
class EventView {
 public:
  EventView(const LiveOptions& live, cv::Size size) : live_(live), picture_(size, CV_8UC3, kPaper) {
    shows_ = std::getenv("DISPLAY") || std::getenv("WAYLAND_DISPLAY");
    if (shows_) return;
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
    std::filesystem::rename(unfinished_, partial_path(live_.video));
    commit_partial(live_.video);
  }
  bool shows() const { return shows_; }

 private:
  bool flush() {
    next_us_ += live_.picture_us;
    int key = -1;
    if (shows_) {
      cv::imshow("events", picture_);
      key = cv::waitKey(1);
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
  std::filesystem::path unfinished_;
  bool shows_ = false;
  std::int64_t next_us_ = live_.picture_us;
};

cv::VideoCapture open_source(const std::string& source, bool camera) {
  cv::VideoCapture capture;
  int index = 0;
  if (const auto colon = source.find(':'); camera && colon != std::string::npos)
    std::from_chars(source.data() + colon + 1, source.data() + source.size(), index);
  if (!(camera ? capture.open(index) : capture.open(source)))
    throw not_found(source, camera ? "no such camera" : "no video that OpenCV can read");
  return capture;
}

}  // namespace

SenseReport sense_live(const LiveOptions& live, const SenseOptions& sense, const PictureOptions& pictures) {
  const bool camera = live.source == "camera" || live.source.starts_with("camera:");
  cv::VideoCapture capture = open_source(live.source, camera);
  const Linear linear(pictures);
  cv::Mat frame;
  if (!capture.read(frame)) throw bad_input(live.source, "", "no frame", "a video");

  const Chip given = load_chip(sense.chip, sense.overrides);
  const Chip chip = sense.no_noise ? without_noise(given) : given;
  StackInfo info;
  info.quantity = Quantity::relative;
  info.width = frame.cols;
  info.height = frame.rows;
  info.bands = linear.bands_of(frame);
  const std::vector<double> amperes = amperes_per_unit(chip, info, sense.light);
  ModelChoice model = sense.model;
  if (model.white_fa == 0) model.white_fa = sense.light.photocurrent_a.value_or(kDefaultWhite_a) * 1e15;
  Sensor sensor(chip, info.width, info.height, sense.seed, 1.0, model, {!sense.ideal_readout, false});
  const auto writer = events::open_writer(sense.output, {info.width, info.height, chip.name}, sense.format);
  EventView view(live, frame.size());

  const double rate = pictures.times.fps.value_or(capture.get(cv::CAP_PROP_FPS));
  if (!camera && !(rate > 0)) throw bad_input(live.source, "times", "none", "--fps");
  const auto start = std::chrono::steady_clock::now();
  const std::size_t pixels = frame.total();
  std::vector<float> plane(pixels);
  std::int64_t frames = 0, count = 0;
  double t_us = 0;
  bool last = false;
  LabelledEvents found;
  while (!last) {
    const std::vector<float> values = linear(frame);
    std::ranges::fill(plane, 0.0f);
    for (std::size_t b = 0; b < amperes.size(); ++b)
      for (std::size_t i = 0; i < pixels; ++i)
        plane[i] += static_cast<float>(amperes[b] * 1e15) * values[b * pixels + i];
    const double now_us = t_us;
    ++frames;
    last = !capture.read(frame) || (live.seconds && now_us >= *live.seconds * 1e6);
    const auto clock_us = std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start).count();
    t_us = camera ? std::max(clock_us, t_us + 1) : static_cast<double>(frames) * 1e6 / rate;

    const float* pointer = plane.data();
    found.events.clear();
    sensor.push({&pointer, 1}, {&now_us, 1}, last, found);
    writer->write(found.events);
    count += static_cast<std::int64_t>(found.events.size());
    if (!view.add(found.events, 0)) last = true;
    if (!last && (frame.cols != info.width || frame.rows != info.height))
      throw bad_input(live.source, fmt::format("frame {}", frames), fmt::format("{}x{}", frame.cols, frame.rows),
                      fmt::format("{}x{} as the first", info.width, info.height));
  }
  view.close();
  writer->close();
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  SenseReport report;
  report.config = {{"chip", chip_to_json(chip)},
                   {"model", model_to_json(model)},
                   {"seed", sense.seed},
                   {"input", camera ? "camera" : "video"},
                   {"view", view.shows() ? "window" : live.video.string()}};
  report.results = {
      {"width", info.width}, {"height", info.height},       {"frames", frames},
      {"events", count},     {"dropped", sensor.dropped()}, {"frames_per_s", static_cast<double>(frames) / seconds}};
  return report;
}

}  // namespace pecs::sensor
