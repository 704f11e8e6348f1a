// The row arbiter by hand, its throughput, and the causes of events.
#include "pecs/sensor/readout.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <random>
#include <tuple>

#include "pecs/sensor/sensor.h"

namespace pecs::sensor {
namespace {

using events::Event;

Chip with(double rate_hz, double row_s, double jitter_s = 0, double timestamp_s = 1e-6) {
  Chip chip = load_chip("ideal");
  chip.readout_rate_hz = rate_hz;
  chip.readout_row_s = row_s;
  chip.clock_jitter_s = jitter_s;
  chip.timestamp_s = timestamp_s;
  return chip;
}

LabelledEvents read(Readout& readout, const std::vector<Event>& events, bool last = true) {
  LabelledEvents out;
  readout.push({{events.begin(), events.end()}, {}}, last, out);
  return out;
}

}  // namespace

TEST(Readout, ServesTheRowThatWaitedLongest) {
  Readout readout(with(1e6, 10e-6), 8, 4, 1);  // 10 us to select a row, 1 us an event
  const auto out = read(readout, {{100, 3, 2, 1}, {101, 5, 1, 0}, {102, 1, 2, 0}, {103, 0, 1, 1}, {105, 7, 3, 1}});
  // Row 2 at 100 with its one event, free at 111; row 1 with both; row 2 again; row 3.
  const std::vector<Event> expected = {{100, 3, 2, 1}, {111, 0, 1, 1}, {111, 5, 1, 0}, {123, 1, 2, 0}, {134, 7, 3, 1}};
  EXPECT_TRUE(std::ranges::equal(out.events, expected));
  EXPECT_EQ(readout.dropped(), 0);
}

TEST(Readout, EventsOfAVectorAreSentAtOnce) {
  Chip chip = with(2e6, 10e-6);
  chip.readout_vector_px = 2;  // 1 us a vector
  Readout readout(chip, 8, 5, 1);
  const auto out =
      read(readout, {{100, 3, 2, 1}, {101, 5, 3, 0}, {102, 0, 3, 1}, {103, 4, 3, 1}, {104, 2, 3, 0}, {105, 7, 4, 1}});
  // Row 2 at 100 with one vector, free at 111; row 3 with the vectors 0, 2 and 4, free at 124; row 4.
  const std::vector<Event> expected = {{100, 3, 2, 1}, {111, 0, 3, 1}, {111, 2, 3, 0},
                                       {111, 4, 3, 1}, {111, 5, 3, 0}, {124, 7, 4, 1}};
  EXPECT_TRUE(std::ranges::equal(out.events, expected));
}

TEST(Readout, LinesInTurn) {
  for (const bool columns : {false, true}) {
    Chip chip = with(1e6, 10e-6);  // 10 us for a line with events, 1 us an event, 2 us for a line without
    chip.readout_idle_s = 2e-6;
    chip.readout_columns = columns;
    Readout readout(chip, 4, 4, 1);
    // Line 2 is visited at 100, after 50 lines, and free at 111; line 3 with both events, free at 123; line 0, free at
    // 134; line 1 without events; line 2 again.
    const std::vector<Event> fired = {{100, 3, 2, 1}, {101, 1, 0, 0}, {102, 1, 2, 0}, {103, 0, 3, 1}, {104, 2, 3, 1}};
    std::vector<Event> in = fired,
                       expected = {{100, 3, 2, 1}, {111, 0, 3, 1}, {111, 2, 3, 1}, {123, 1, 0, 0}, {136, 1, 2, 0}};
    if (columns)
      for (auto* events : {&in, &expected})
        for (Event& e : *events) std::swap(e.x, e.y);
    EXPECT_TRUE(std::ranges::equal(read(readout, in).events, expected)) << columns;
    EXPECT_EQ(readout.dropped(), 0);
  }
}

TEST(Readout, APixelThatWaitsHasNoSecondEvent) {
  Readout readout(with(1e6, 10e-6), 8, 4, 1);
  const auto out = read(readout, {{100, 0, 0, 1}, {101, 3, 2, 1}, {105, 3, 2, 1}, {106, 3, 2, 0}, {200, 3, 2, 1}});
  EXPECT_EQ(out.events.size(), 3u);
  EXPECT_EQ(readout.dropped(), 2);
}

// Overload: as many events leave as the rate allows, the others are counted.
TEST(Readout, ThroughputIsTheChips) {
  const double rate_hz = 2e6;
  Readout readout(with(rate_hz, 0), 64, 64, 1);
  std::mt19937 random(5);
  std::vector<Event> events;
  for (int t = 0; t < 200000; ++t)  // 8 events a us, four times too many
    for (int i = 0; i < 8; ++i)
      events.push_back({t, static_cast<std::uint16_t>(random() % 64), static_cast<std::uint16_t>(random() % 64), 1});
  const auto n = events.size();
  const auto out = read(readout, events);
  EXPECT_EQ(out.events.size() + static_cast<std::size_t>(readout.dropped()), n);
  std::size_t sent = 0;
  for (std::size_t i = 0; i < out.events.size(); ++i) {
    sent += out.events[i].t_us < 200000;
    ASSERT_GE(out.events[i].t_us, out.events[i ? i - 1 : 0].t_us);
  }
  EXPECT_NEAR(static_cast<double>(sent) / (rate_hz * 0.2), 1, 0.005);
}

TEST(Readout, TimeBaseAndJitter) {
  Readout coarse(with(0, 0, 0, 1e-4), 8, 8, 1);
  for (const Event& e : read(coarse, {{123, 0, 0, 1}, {399, 1, 1, 1}, {400, 2, 2, 1}}).events)
    EXPECT_EQ(e.t_us % 100, 0);
  std::vector<Event> apart;
  for (int i = 0; i < 20000; ++i) apart.push_back({1000 + 1000 * i, 1, static_cast<std::uint16_t>(i % 8), 1});
  Readout jitter(with(0, 0, 20e-6), 8, 8, 1), other(with(0, 0, 20e-6), 8, 8, 2);
  const auto out = read(jitter, apart);
  EXPECT_NE(out.events, read(other, apart).events);
  double sum = 0, square = 0;
  for (std::size_t i = 0; i < apart.size(); ++i) {
    const auto d = static_cast<double>(out.events[i].t_us - apart[i].t_us) + 0.5;  // rounded down
    sum += d;
    square += d * d;
  }
  const auto n = static_cast<double>(apart.size());
  EXPECT_NEAR(sum / n, 0, 4 * 20 / std::sqrt(n));
  EXPECT_NEAR(std::sqrt(square / n), 20, 4 * 20 / std::sqrt(2 * n));
}

// Event by event, each waits for the next; in one piece, a fast chip serves most at once.
TEST(Readout, ChunksChangeNothing) {
  std::mt19937 random(7);
  std::vector<Event> events;
  for (int t = 0; t < 20000; t += static_cast<int>(random() % 3))
    for (std::size_t n = random() % 9; n > 0; --n)
      events.push_back({t, static_cast<std::uint16_t>(random() % 32), static_cast<std::uint16_t>(random() % 32), 0});
  std::ranges::sort(events, {}, [](const Event& e) { return std::tuple(e.t_us, e.y, e.x); });
  Chip in_turn = with(7e5, 2e-6);
  in_turn.readout_idle_s = 7e-7;
  for (const Chip& chip : {with(7e5, 2e-6, 3e-6), with(1e9, 3e-7), with(1e9, 1e-8, 2e-6), in_turn}) {
    Readout whole(chip, 32, 32, 3);
    const auto expected = read(whole, events);
    for (const std::size_t chunk : {1u, 13u}) {
      Readout parts(chip, 32, 32, 3);
      LabelledEvents out;
      for (std::size_t i = 0; i < events.size(); i += chunk) {
        const std::size_t end = std::min(events.size(), i + chunk);
        parts.push(
            {{events.begin() + static_cast<std::ptrdiff_t>(i), events.begin() + static_cast<std::ptrdiff_t>(end)}, {}},
            end == events.size(), out);
      }
      EXPECT_EQ(out.events, expected.events);
      EXPECT_EQ(parts.dropped(), whole.dropped());
    }
    EXPECT_GT(whole.dropped(), 0);
  }
}

namespace {

LabelledEvents labelled(const Chip& chip, double light_fa, double rate_per_us, double seconds, int side = 60) {
  Sensor sensor(chip, side, side, 1, 1.0, {}, {false, true});
  const int frames = static_cast<int>(seconds * 1e3);
  LabelledEvents out;
  for (int i = 0; i <= frames; ++i) {
    const std::vector<float> plane(static_cast<std::size_t>(side * side),
                                   static_cast<float>(light_fa * std::exp(rate_per_us * i * 1000)));
    const float* pointer = plane.data();
    const double t_us = i * 1000.0;
    sensor.push({&pointer, 1}, {&t_us, 1}, i == frames, out);
  }
  EXPECT_EQ(out.events.size(), out.causes.size());
  return out;
}

double part(const LabelledEvents& e, Cause cause) {
  return static_cast<double>(std::ranges::count(e.causes, cause)) / static_cast<double>(e.causes.size());
}

}  // namespace

TEST(Causes, EachAloneIsNamed) {
  const Chip ideal = load_chip("ideal");
  EXPECT_EQ(part(labelled(ideal, 10, 1e-5, 0.2), Cause::signal), 1);
  EXPECT_EQ(part(labelled(load_chip("ideal", {"leak_rate_hz=20"}), 10, 0, 0.2), Cause::leak), 1);
  EXPECT_EQ(part(labelled(load_chip("ideal", {"background_on_hz=20"}), 10, 0, 0.2), Cause::noise), 1);
  EXPECT_EQ(part(labelled(load_chip("ideal", {"hot_pixel_fraction=0.1", "hot_pixel_hz=100"}), 10, 0, 0.2), Cause::hot),
            1);
  Chip shot = without_noise(load_chip("imx636"));
  shot.noise_std = 0.1;
  shot.contrast_threshold_on = shot.contrast_threshold_off = 0.1;
  EXPECT_EQ(part(labelled(shot, 100, 0, 0.2), Cause::noise), 1);
}

// An exposure steps the output of every pixel up at its begin and down at its end, in any light. The output relaxes
// with the amplifier's time constant, so a pixel that fired, and saw again within it, fires back.
TEST(Causes, ExposuresFireUpAndDownAtTheFrameClock) {
  Chip chip = without_noise(load_chip("davis346"));
  chip.frame_row_s = 1e-5;
  chip.frame_step_slow = 0;
  const auto fired = [&](double step, double refractory, double light_fa = 0.1) {
    chip.frame_step = step * chip.contrast_threshold_on;
    chip.refractory_period_s = refractory / (2 * std::numbers::pi * chip.amplifier_cutoff_hz);
    return labelled(chip, light_fa, 0, 0.2);
  };
  EXPECT_EQ(fired(1.5, 10).events.size(), 0);  // only on request
  chip.takes_frames = true;
  EXPECT_EQ(fired(0.95, 10).events.size(), 0);
  for (const double light_fa : {0.1, 1e7}) {
    const LabelledEvents all = fired(1.5, 10, light_fa);
    EXPECT_EQ(part(all, Cause::frame), 1);
    EXPECT_EQ(all.events.size(), 60 * 60 * 2 * 5);  // 5 frames in 0.2 s
    for (const Event& e : all.events) {
      const double begin_us = std::fmod(static_cast<double>(e.t_us), 1e6 * chip.frame_period_s) - 10 * e.y;
      EXPECT_NEAR(begin_us, e.p ? 0 : 1e6 * chip.frame_exposure_s, 1);
    }
  }
  EXPECT_EQ(fired(1.5, std::log(1.6)).events.size(), 60 * 60 * 2 * 5);  // 1.5 / 1.6 thresholds are left to go back
  EXPECT_EQ(fired(1.5, std::log(1.4)).events.size(), 60 * 60 * 4 * 5);

  // The slow part S has its own time constant: it goes back by a threshold when S (exp(-r / tau) - exp(-t / tau)) is
  // one.
  chip.frame_step_slow = 1.5 * chip.contrast_threshold_on;
  chip.frame_step_slow_s = 1e-3;
  const double back_us = -1e3 * std::log(std::exp(-0.2) - 1 / 1.5);
  const LabelledEvents slow = fired(0, 0.2e-3 * 2 * std::numbers::pi * chip.amplifier_cutoff_hz);
  EXPECT_EQ(slow.events.size(), 60 * 60 * 4 * 5);
  for (const Event& e : slow.events) {
    const double begin_us = std::fmod(static_cast<double>(e.t_us), 1e6 * chip.frame_period_s) - 10 * e.y;
    const bool ends = begin_us > 5e5 * chip.frame_exposure_s;
    EXPECT_NEAR(begin_us, (ends ? 1e6 * chip.frame_exposure_s : 0) + (e.p != ends ? 0 : back_us), 6);
  }
}

TEST(Causes, SignalAmongLeakIsTheLargerPart) {
  // The light brings 10 events/s, the leak 3: each event is mostly signal; the other way round, mostly leak.
  const Chip chip = load_chip("ideal", {"leak_rate_hz=3"});
  EXPECT_EQ(part(labelled(chip, 10, 10 * 0.2e-6, 1), Cause::signal), 1);
  EXPECT_EQ(part(labelled(chip, 10, 1 * 0.2e-6, 1), Cause::leak), 1);
}

TEST(HotPixels, AreSomeAndFireAtTheirRate) {
  const Chip chip = load_chip("ideal", {"hot_pixel_fraction=0.05", "hot_pixel_hz=200"});
  const auto out = labelled(chip, 10, 0, 1, 100);
  std::map<int, double> counts;
  for (const Event& e : out.events) {
    ++counts[e.y * 100 + e.x];
    EXPECT_EQ(e.p, 1);
  }
  const auto pixels = static_cast<double>(counts.size()), n = static_cast<double>(out.events.size());
  EXPECT_NEAR(pixels, 500, 4 * std::sqrt(500 * 0.95));
  EXPECT_NEAR(n / pixels, 200, 4 * std::sqrt(200 / pixels));
  double square = 0;
  for (const auto& [pixel, count] : counts) square += (count - 200) * (count - 200);
  EXPECT_NEAR(square / pixels, 200, 4 * 200 * std::sqrt(2 / pixels));  // Poisson: variance = mean
}

}  // namespace pecs::sensor
