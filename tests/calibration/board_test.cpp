#include "pecs/calibration/board.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "pecs/calibration/timestamp_wrap.h"
#include "pecs/error.h"
#include "pecs/sensor/sensor.h"
#include "random_events.h"
#include "shared.h"

namespace pecs::calibration {
namespace {

constexpr int kWidth = 320, kHeight = 200;

// A board in the picture's plane: rotated by angle_deg about its centre `at`, with `pitch` px per square (or circle).
struct Scene {
  BoardShape shape{Pattern::checkerboard, 4, 3, 1};
  double pitch = 24;
  std::function<cv::Point2d(double)> at = [](double t_s) { return cv::Point2d(130 + 900 * t_s, 100 + 300 * t_s); };
  std::function<double(double)> angle_deg = [](double) { return 8.0; };
  std::function<double(double)> light = [](double) { return 1.0; };
  double seconds = 0.03;

  cv::Point2d seen(const cv::Point3d& p, double t_s) const {
    const double a = angle_deg(t_s) * std::numbers::pi / 180, u = p.x * pitch, v = p.y * pitch;
    return at(t_s) + cv::Point2d(u * std::cos(a) - v * std::sin(a), u * std::sin(a) + v * std::cos(a));
  }

  float value(const std::vector<cv::Point3d>& points, double x, double y, double t_s) const {
    const auto inside = [](double distance_px) { return std::clamp(0.5 + distance_px / 1.6, 0.0, 1.0); };
    const double a = angle_deg(t_s) * std::numbers::pi / 180;
    const cv::Point2d d = cv::Point2d(x, y) - at(t_s);
    const double u = d.x * std::cos(a) + d.y * std::sin(a), v = -d.x * std::sin(a) + d.y * std::cos(a);
    double black = 0;
    if (shape.pattern == Pattern::checkerboard) {
      const auto wave = [&](double w, int squares) {  // +1 in the first square, -1 in the next, and so on
        const double part = w / pitch + squares / 2.0, to_line = (part - std::round(part)) * pitch;
        const double up = std::clamp(to_line / 0.8, -1.0, 1.0);
        return (std::lround(part) % 2 == 0 ? 1 : -1) * up;
      };
      const double hu = (shape.columns + 1) * pitch / 2, hv = (shape.rows + 1) * pitch / 2;
      black = inside(std::min(hu - std::abs(u), hv - std::abs(v))) *
              (0.5 - 0.5 * wave(u, shape.columns + 1) * wave(v, shape.rows + 1));
    } else {
      for (const auto& p : points)
        black = std::max(black, inside(0.28 * pitch - std::hypot(u - p.x * pitch, v - p.y * pitch)));
    }
    return static_cast<float>(0.07 + 0.77 * (1 - black) * light(t_s));
  }

  events::Recording recorded() const {
    const double step_s = 4e-4;
    sensor::Sensor sensor(sensor::load_chip("imx636"), kWidth, kHeight, 1, 30'000, {}, {.readout = true});  // 30 pA
    sensor::LabelledEvents out;
    const auto points = shape.points_mm();
    std::vector<float> frame(std::size_t{kWidth} * kHeight);
    const int frames = static_cast<int>(seconds / step_s) + 1;
    for (int i = 0; i < frames; ++i) {
      for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x)
          frame[static_cast<std::size_t>(y) * kWidth + x] = value(points, x + 0.5, y + 0.5, i * step_s);
      const float* planes[] = {frame.data()};
      const double t_us[] = {i * step_s * 1e6};
      sensor.push(planes, t_us, i + 1 == frames, out);
    }
    return events::recording_of({{kWidth, kHeight, ""}, {out.events.begin(), out.events.end()}}, "x.raw", 0, INT64_MAX);
  }

  double rms_px(const BoardView& view) const {
    double squares = 0;
    const auto points = shape.points_mm();
    for (std::size_t i = 0; i < points.size(); ++i) {
      const cv::Point2d d = view.points[i] - seen(points[i], view.t_us * 1e-6);
      squares += d.dot(d);
    }
    return std::sqrt(squares / (2.0 * static_cast<double>(points.size())));
  }
};

void expect_found(const Scene& scene, const BoardSearch& search, std::size_t views, const char* what) {
  SCOPED_TRACE(what);
  ASSERT_GE(search.views.size(), views) << (search.missed.empty() ? "" : search.missed[0]);
  for (const auto& view : search.views)
    EXPECT_LT(scene.rms_px(view), 0.25) << "at " << view.t_us << " us, " << view.motion;
}

std::string refusal(const std::function<void()>& f) {
  ExitCode code{};
  const std::string line = pecs::tests::error_of(f, &code);
  EXPECT_EQ(code, ExitCode::bad_input);
  return line;
}

TEST(Board, CornersOfAMovingCheckerboard) {
  const Scene scene;
  const auto search = find_boards(scene.recorded(), scene.shape, 3, "x.raw");
  expect_found(scene, search, 3, "moving");
  for (const auto& view : search.views) {
    EXPECT_NEAR(view.speed_px_s, std::hypot(900, 300), 30);
    EXPECT_GT(view.deviation_px, 0);
  }
}

TEST(Board, CornersOfARotatingCheckerboard) {
  Scene scene;
  scene.at = [](double t_s) { return cv::Point2d(150.3 + 500 * t_s, 100.6); };
  scene.angle_deg = [](double t_s) { return 500 * t_s - 10; };
  const auto search = find_boards(scene.recorded(), scene.shape, 1, "x.raw");
  expect_found(scene, search, 1, "turning");
  EXPECT_NE(search.views[0].motion, "translation");
}

TEST(Board, GridsOfCircles) {
  Scene scene;
  scene.shape = {Pattern::circles, 5, 4, 1};
  scene.pitch = 28;
  expect_found(scene, find_boards(scene.recorded(), scene.shape, 1, "x.raw"), 1, "symmetric");
  scene.shape = {Pattern::asymmetric_circles, 4, 7, 1};
  scene.pitch = 18;
  expect_found(scene, find_boards(scene.recorded(), scene.shape, 1, "x.raw"), 1, "asymmetric");
}

TEST(Board, ABlinkingBoardAndItsFrequency) {
  Scene scene;
  scene.at = [](double) { return cv::Point2d(160.3, 100.6); };
  scene.seconds = 0.05;
  scene.light = [](double t_s) { return std::fmod(t_s * 125, 1) < 0.5 ? 1.0 : 0.1; };
  Blinking blinking;
  expect_found(scene, find_blinking_boards(scene.recorded(), scene.shape, 1, "x.raw", blinking), 1, "blinking");
  EXPECT_NEAR(blinking.frequency_hz, 125, 2);
}

TEST(Board, ABoardThatIsNotFoundIsAnError) {
  const Scene scene;
  const events::Recording recording = scene.recorded();
  const std::string wrong = refusal([&] { find_boards(recording, {Pattern::checkerboard, 5, 3, 1}, 3, "x.raw"); });
  EXPECT_NE(wrong.find("best candidate: a checkerboard of 4 x 3 inner corners"), std::string::npos) << wrong;

  Scene outside;  // its right squares are out of view
  outside.at = [](double t_s) { return cv::Point2d(290 + 900 * t_s, 100); };
  EXPECT_NE(refusal([&] { find_boards(outside.recorded(), scene.shape, 1, "x.raw"); }).find("nothing found"),
            std::string::npos);

  const events::Recording noise = events::recording_of(
      {{kWidth, kHeight, ""}, tests::random_events(100'000, 3, kWidth, kHeight, 2'000'000)}, "x.raw", 0, INT64_MAX);
  EXPECT_NE(refusal([&] { find_boards(noise, scene.shape, 2, "x.raw"); }).find("nothing"), std::string::npos);
  Blinking blinking;
  EXPECT_NE(refusal([&] { find_blinking_boards(noise, scene.shape, 1, "x.raw", blinking); }).find("nothing blinks"),
            std::string::npos);
}

TEST(Board, AReversingBoardIsFoundWhereItMoves) {
  Scene scene;
  scene.seconds = 0.05;
  scene.at = [](double t_s) { return cv::Point2d(130 + 900 * (t_s < 0.025 ? t_s : 0.05 - t_s), 100.6); };
  const auto search = find_boards(scene.recorded(), scene.shape, 5, "x.raw");
  EXPECT_GE(search.views.size(), 3U);
  for (const auto& view : search.views) EXPECT_LT(scene.rms_px(view), 1.0) << "at " << view.t_us;
}

TEST(UnwrapTimestamps, UnwrapsACounterAndRejectsOtherDecreases) {
  const auto times = [](const std::vector<std::int64_t>& t) {
    events::Stream s{{4, 4, ""}, {}};
    for (const auto v : t) s.events.push_back({v, 1, 1, 1});
    return s;
  };
  std::string note;
  const auto s = unwrap_timestamps(times({16'777'000, 16'777'200, 3, 700}), "x.raw", note);
  EXPECT_EQ(s.events[2].t_us, 16'777'219);
  EXPECT_EQ(s.events[3].t_us, 16'777'916);
  EXPECT_NE(note.find("16777216 us"), std::string::npos);
  note.clear();
  EXPECT_EQ(unwrap_timestamps(times({10, 8, 12}), "x.raw", note).events[1].t_us, 8);
  EXPECT_TRUE(note.empty());
  EXPECT_NE(refusal([&] { unwrap_timestamps(times({5'000'000, 1'234'567}), "x.raw", note); }).find("a decrease"),
            std::string::npos);
}

}  // namespace
}  // namespace pecs::calibration
