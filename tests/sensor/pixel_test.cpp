// The whole array, from frames in memory to sorted events, against what the model says in closed form.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <numbers>

#include "clip.h"
#include "pecs/error.h"
#include "pecs/sensor/random.h"

namespace pecs::sensor {
namespace {

using events::Event;

std::vector<Event> run(const Chip& chip, const Clip& clip, std::uint64_t seed = 1, std::size_t batch = 1000,
                       int threads = 2) {
  Sensor sensor(chip, clip.width, clip.height, seed, 1.0);
  return run_clip(sensor, clip, batch, threads);
}

// Its photoreceptor alone.
Chip quiet_imx636() { return without_noise(load_chip("imx636", {"amplifier_cutoff_hz=0"})); }

// A busy scene: bars that move, brighten and darken.
double bars(int x, int y, double t_us) { return 1.5 + 1.4 * std::sin(0.3 * x + 0.05 * y - t_us * 2e-3); }

}  // namespace

TEST(Pixel, EventsStandOneThresholdApartOnALogRamp) {
  const Chip ideal = load_chip("ideal");
  const double rate = 2e-4;  // ln units per us
  const Clip up = make_clip(5, 3, 21, 1000, [&](int, int, double t) { return std::exp(rate * t); });
  const auto events = run(ideal, up);
  ASSERT_EQ(events.size(), 15u * static_cast<std::size_t>(20000 * rate / 0.2 - 1e-6));
  std::map<int, int> seen;
  for (const Event& e : events) {
    const int k = ++seen[e.y * 5 + e.x];
    EXPECT_EQ(e.p, 1);
    EXPECT_NEAR(static_cast<double>(e.t_us), k * 0.2 / rate, 0.6);
  }
  const Clip down = make_clip(5, 3, 21, 1000, [&](int, int, double t) { return std::exp(-rate * t); });
  for (const Event& e : run(ideal, down)) EXPECT_EQ(e.p, 0);
}

// The rate of events must not tell where the frames are. With Fritsch & Butland's monotone cubics (slope 0 at each
// extremum) these numbers are 0.27 and 0.10, with parabolas 0.16 and 0.06; here 0.091 and 0.012.
TEST(Pixel, RateHasNoLineAtTheFrames) {
  for (const auto& [frames, most] : {std::pair{5.3, 0.12}, {8.3, 0.025}}) {
    const double period_us = 1000 * frames;
    const Clip waves = make_clip(600, 1, 60, 1000, [&](int x, int, double t) {
      return std::exp(0.7 * std::sin(2 * std::numbers::pi * (t / period_us + 0.381966 * x)));
    });
    for (const char* more : {"refractory_period_s=0", "refractory_period_s=1e-9"}) {  // without and with a state
      double cosine = 0, sine = 0, count = 0;
      for (const Event& e : run(load_chip("ideal", {more}), waves)) {
        if (e.t_us < 5000 || e.t_us >= 55000) continue;
        cosine += std::cos(2 * std::numbers::pi * 1e-3 * static_cast<double>(e.t_us));
        sine += std::sin(2 * std::numbers::pi * 1e-3 * static_cast<double>(e.t_us));
        ++count;
      }
      ASSERT_GT(count, 30000);
      EXPECT_LT(2 * std::hypot(cosine, sine) / count, most) << frames << ' ' << more;
    }
  }
}

// More than are solved together, of each pixel.
// Pixels with thresholds only have a kernel of their own: it finds the crossings on both sides of an extremum.
TEST(Pixel, TurningLightHasTheEventsOfPixelsWithAState) {
  const Clip clip = make_clip(200, 1, 40, 1000, [](int x, int, double t) {
    return std::exp(0.6 * std::sin(1e-3 * t * (0.3 + 0.004 * x)) + 0.2 * std::sin(2.9e-3 * t + x));
  });
  const auto events = run(load_chip("ideal"), clip);
  const auto others = run(load_chip("ideal", {"refractory_period_s=1e-12"}), clip);
  ASSERT_GT(events.size(), 5000u);
  const auto of_pixels = [](const std::vector<Event>& all) {
    std::map<int, std::vector<Event>> pixels;
    for (const Event& e : all) pixels[e.x].push_back(e);
    return pixels;
  };
  auto a = of_pixels(events), b = of_pixels(others);
  for (auto& [x, of_pixel] : a) {
    ASSERT_EQ(of_pixel.size(), b[x].size()) << "x " << x;
    for (std::size_t i = 0; i < of_pixel.size(); ++i) {
      EXPECT_EQ(of_pixel[i].p, b[x][i].p);
      // Where light is slow: cubic.h.
      EXPECT_NEAR(static_cast<double>(of_pixel[i].t_us), static_cast<double>(b[x][i].t_us), 200) << x;
    }
  }
}

TEST(Pixel, ThousandEventsInAnInterval) {
  const Chip chip = load_chip("ideal", {"contrast_threshold_on=0.01", "contrast_threshold_off=0.01"});
  const double rate = 1e-4;
  const Clip up = make_clip(40, 3, 3, 100000, [&](int, int, double t) { return std::exp(rate * t); });
  std::map<int, int> seen;
  for (const Event& e : run(chip, up)) {
    const int k = ++seen[e.y * 40 + e.x];
    EXPECT_NEAR(static_cast<double>(e.t_us), k * 0.01 / rate, 2) << k;  // ln I is a float of up to 20
  }
  ASSERT_EQ(seen.size(), 120u);
  for (const auto& [pixel, count] : seen) EXPECT_NEAR(count, 2000, 1) << pixel;
}

TEST(Pixel, SlowDriftIsNotForgotten) {  // esim_py skips steps below 1e-6 and then sticks
  const Clip drift = make_clip(2, 1, 3001, 1000, [](int, int, double t) { return std::exp(1e-10 * t * 1000); });
  const auto events = run(load_chip("ideal"), drift);
  ASSERT_EQ(events.size(), 2u);
  EXPECT_NEAR(static_cast<double>(events[0].t_us), 2e6, 50);
}

TEST(Pixel, RefractoryPeriodDelaysTheReference) {
  Chip chip = load_chip("ideal", {"refractory_period_s=0.0003"});
  const double rate = 2e-4;
  const Clip up = make_clip(1, 1, 21, 1000, [&](int, int, double t) { return std::exp(rate * t); });
  const auto events = run(chip, up);
  ASSERT_GE(events.size(), 10u);
  for (std::size_t i = 1; i < events.size(); ++i)
    EXPECT_NEAR(static_cast<double>(events[i].t_us - events[i - 1].t_us), 0.2 / rate + 300, 1.1);
}

TEST(Pixel, LeakMakesOnEventsAtItsRate) {
  const Chip chip = load_chip("ideal", {"leak_rate_hz=5"});
  const Clip still = make_clip(40, 40, 101, 10000, [](int, int, double) { return 1.0; });
  const auto events = run(chip, still);
  EXPECT_NEAR(static_cast<double>(events.size()) / 1600, 5, 1.01);
  EXPECT_NEAR(static_cast<double>(events[0].t_us), 2e5, 50);
  for (const Event& e : events) EXPECT_EQ(e.p, 1);
}

// V after a step of light from I0 to I1: the logistic curve. The k-th event comes when V has moved by k thresholds.
TEST(Pixel, StepResponseAgainstTheLogisticCurve) {
  Chip chip = quiet_imx636();
  chip.refractory_period_s = chip.dark_current_a = 0;
  const double a_per_us = 2 * std::numbers::pi * chip.corner_hz_per_a * 1e-21;
  for (const auto& [i0, i1] : {std::pair{1.0, 10.0}, {10.0, 1.0}, {300.0, 2000.0}, {3.0, 0.6}, {1e5, 1e4}}) {
    // The step happens within one short interval, then light is constant.
    Clip clip = make_clip(3, 1, 2, 0.01, [&, a = i0, b = i1](int, int, double t) { return t > 0 ? b : a; });
    for (int i = 1; i <= 600; ++i) {
      clip.frames.push_back(clip.frames[1]);
      clip.t_us.push_back(0.01 + 500 * i);
    }
    const auto events = run(chip, clip);
    const bool on = i1 > i0;
    const double threshold = on ? chip.contrast_threshold_on : chip.contrast_threshold_off;
    const auto expected = static_cast<std::size_t>(std::abs(std::log(i1 / i0)) / threshold);
    ASSERT_EQ(events.size(), 3 * expected) << i0 << " -> " << i1;
    for (std::size_t k = 0; k < expected; ++k) {
      const double u = i0 * std::exp((on ? 1.0 : -1.0) * threshold * static_cast<double>(k + 1));
      // x where u(x) = I1 u0 e^x / (I1 + u0 (e^x - 1))
      const double t_us = std::log(u * (i1 - i0) / (i0 * (i1 - u))) / (a_per_us * i1);
      EXPECT_NEAR(static_cast<double>(events[3 * k].t_us), t_us, 1 + 2e-4 * t_us)
          << i0 << " -> " << i1 << " event " << k;
      EXPECT_EQ(events[3 * k].p, on);
    }
  }
}

TEST(Pixel, MismatchShowsInTheFirstEvent) {
  Chip chip = load_chip("ideal", {"threshold_mismatch=0.16"});
  const double rate = 1e-4;
  const Clip up = make_clip(120, 100, 31, 100, [&](int, int, double t) { return std::exp(rate * t); });
  std::map<int, double> first;
  for (const Event& e : run(chip, up)) first.try_emplace(e.y * 120 + e.x, static_cast<double>(e.t_us) * rate / 0.2 - 1);
  // 1 in 1e9 thresholds lies outside the ramp.
  double sum = 0, square = 0;
  for (const auto& [pixel, d] : first) {
    sum += d;
    square += d * d;
  }
  const auto n = static_cast<double>(first.size());
  ASSERT_GT(n, 11900);
  EXPECT_NEAR(sum / n, 0, 0.16 * 4 / std::sqrt(n));
  EXPECT_NEAR(std::sqrt(square / n), 0.16, 0.16 * 4 / std::sqrt(2 * n));
}

TEST(Pixel, TimesMustRise) {
  Clip clip = make_clip(4, 4, 3, 1000, bars);
  clip.t_us[2] = 500;
  EXPECT_THROW(run(load_chip("ideal"), clip), Error);
  clip.t_us = {0, 1000, 2e9};
  EXPECT_THROW(run(load_chip("ideal"), clip), Error);
}

}  // namespace pecs::sensor
