#include "pecs/metrics/compare.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "pecs/error.h"
#include "random_events.h"
#include "shared.h"

namespace pecs::metrics {
namespace {

using events::Event;
using events::Stream;
using tests::random_events;

Stream stream_of(std::vector<Event> events, int width = 64, int height = 48) {
  return {{width, height, ""}, std::move(events)};
}

std::string error_of(const Stream& real, const Stream& sim, const CompareOptions& options = {}) {
  return pecs::tests::error_of([&] { compare(real, "real.raw", sim, "sim.raw", options); });
}

TEST(Compare, WindowCountsFromEachStreamsFirstEvent) {
  const auto events = random_events(4000, 1);
  auto late = events;
  for (auto& e : late) e.t_us += 123'456;
  CompareOptions options{.window_us = 5000};
  const auto c = compare(stream_of(events), "r", stream_of(late), "s", options);
  EXPECT_EQ(c.distance.chamfer(), 0);
  EXPECT_EQ(c.real.events, c.sim.events);
  EXPECT_LT(c.real.events, 2300U);  // half of the span
  EXPECT_GT(c.real.events, 1700U);
  EXPECT_EQ(c.window_us, 5000);

  options.common_origin = true;
  EXPECT_NE(error_of(stream_of(events), stream_of(late), options).find("sim.raw: window: got 0 events"),
            std::string::npos);
}

TEST(Compare, TheWindowIsHalfOpen) {
  const Stream a = stream_of({{10, 1, 1, 1}, {109, 2, 2, 0}, {110, 3, 3, 1}});
  EXPECT_EQ(compare(a, "r", a, "s", {.window_us = 100}).real.events, 2U);
}

TEST(Compare, SummariesOfAKnownStream) {
  // 100 ON events per ms for 5 ms, then 300 OFF events per ms for 5 ms.
  std::vector<Event> events;
  for (std::int64_t i = 0; i < 500; ++i) events.push_back({i * 10, 1, 1, 1});
  for (std::int64_t i = 0; i < 1500; ++i) events.push_back({5000 + i * 10 / 3, 2, 2, 0});
  auto twice = events;
  for (auto& e : twice) e.p = 1 - e.p;
  const auto c = compare(stream_of(events), "r", stream_of(twice), "s", {.window_us = 10'000, .rate_bins = 10});
  EXPECT_DOUBLE_EQ(c.real.on_fraction, 0.25);
  EXPECT_DOUBLE_EQ(c.sim.on_fraction, 0.75);
  EXPECT_NEAR(c.real.rate_hz, 200'000, 100);
  EXPECT_NEAR(c.real.on_hz[0], 100'000, 100);
  EXPECT_NEAR(c.real.off_hz[9], 300'000, 200);
  EXPECT_NEAR(*c.rate_correlation, 1, 1e-4);
  EXPECT_NEAR(*c.on_correlation, -1, 1e-4);
}

TEST(Compare, ASimilarStreamIsBelowTheFloorAndNoiseIsAboveIt) {
  // Compares events on a moving line with another sample of it and with noise.
  const auto line = [](unsigned seed) {
    auto events = random_events(6000, seed);
    for (auto& e : events) e.x = static_cast<std::uint16_t>(e.t_us * 63 / 10'000);
    return stream_of(events);
  };
  const auto like = compare(line(1), "r", line(2), "s", {});
  const auto noise = compare(line(1), "r", stream_of(random_events(6000, 3)), "s", {});
  ASSERT_TRUE(like.floor);
  EXPECT_GT(like.floor->chamfer(), 0);
  EXPECT_LT(like.distance.chamfer(), like.floor->chamfer());  // halves are sparser than the whole
  EXPECT_GT(noise.distance.chamfer(), 2 * like.floor->chamfer());
}

TEST(Compare, RejectsEmptyStreamsAndOtherSensorsAndWarnsOfOnePolarity) {
  const auto a = stream_of(random_events(300, 1));
  EXPECT_EQ(error_of(a, stream_of({})), "sim.raw: got 0 events, wanted at least 1");
  EXPECT_NE(error_of(a, stream_of(random_events(300, 1), 32, 24)).find("sim.raw: sensor size: got 32x24, wanted 64x48"),
            std::string::npos);
  const auto c = compare(a, "r", stream_of(random_events(300, 2, 64, 48, 10'000, 1.0)), "s", {});
  ASSERT_EQ(c.warnings.size(), 1U);
  EXPECT_NE(c.warnings[0].find("s: all 300 events are ON"), std::string::npos);
  EXPECT_TRUE(to_json(c)["off_rate_correlation"].is_null());
}

TEST(Compare, WarnsOfAStreamThatEndsEarly) {
  const auto whole = stream_of(random_events(300, 1)), part = stream_of(random_events(300, 2, 64, 48, 5'000));
  const auto c = compare(whole, "r", part, "s", {});
  ASSERT_EQ(c.warnings.size(), 1U);
  EXPECT_TRUE(c.warnings[0].starts_with("s: events end after ")) << c.warnings[0];
  EXPECT_EQ(compare(whole, "r", part, "s", {.window_us = 5'000}).warnings.size(), 0U);
  EXPECT_EQ(compare(whole, "r", whole, "s", {.window_us = 100'000}).warnings.size(), 2U);  // the scores' unit of time
}

TEST(Compare, IntervalsContainTheScoreAndAreNarrowForUniformStreams) {
  const auto even = compare(stream_of(random_events(8000, 1)), "r", stream_of(random_events(8000, 2)), "s", {});
  EXPECT_LT(even.chamfer_interval.low, even.distance.chamfer());
  EXPECT_GT(even.chamfer_interval.high, even.distance.chamfer());
  EXPECT_LT(even.chamfer_interval.high - even.chamfer_interval.low, 0.05 * even.distance.chamfer());
  auto uneven = random_events(8000, 2);  // good in the first half only
  for (auto& e : uneven)
    if (e.t_us > 5000) e.x = 0;
  const auto c = compare(stream_of(random_events(8000, 1)), "r", stream_of(uneven), "s", {});
  EXPECT_GT(c.chamfer_interval.high - c.chamfer_interval.low, 0.2 * c.distance.chamfer());
  const auto same = compare(stream_of(random_events(800, 1)), "r", stream_of(random_events(800, 1)), "s", {});
  EXPECT_EQ(same.chamfer_interval.high, 0);
  // Times at which one stream is silent count as they do in the score.
  const auto silent = compare(stream_of(random_events(8000, 1)), "r", stream_of(random_events(4000, 2, 64, 48, 5'000)),
                              "s", {.window_us = 10'000});
  EXPECT_LT(silent.chamfer_interval.low, silent.distance.chamfer());
  EXPECT_GT(silent.chamfer_interval.high, silent.distance.chamfer());
  const auto apart = compare(stream_of({{5, 1, 1, 1}}), "r", stream_of({{9000, 1, 1, 1}}), "s",
                             {.window_us = 10'000, .common_origin = true});
  EXPECT_EQ(apart.chamfer_interval.high, apart.distance.chamfer());
}

TEST(Compare, MapsDependOnPositionAndIntervalsOnSpeed) {
  auto left = random_events(20'000, 1);
  for (auto& e : left) e.x = static_cast<std::uint16_t>(e.x / 2);
  auto right = left;
  for (auto& e : right) e.x = static_cast<std::uint16_t>(63 - e.x);
  const auto mirrored = compare(stream_of(left), "r", stream_of(right), "s", {});
  EXPECT_LT(*mirrored.map_correlation, -0.5);
  EXPECT_NEAR(*mirrored.interval_distance_decades, 0, 1e-6);
  EXPECT_NEAR(*compare(stream_of(left), "r", stream_of(left), "s", {}).on_map_correlation, 1, 1e-9);

  auto slower = left;
  for (auto& e : slower) e.t_us *= 2;
  const auto c = compare(stream_of(left), "r", stream_of(slower), "s", {});
  EXPECT_NEAR(*c.interval_distance_decades, std::log10(2), 0.01);
  EXPECT_NEAR(*c.sim.interval_median_us / *c.real.interval_median_us, 2, 0.05);
  EXPECT_NEAR(*c.map_correlation, 1, 1e-9);
  EXPECT_FALSE(compare(stream_of({{5, 1, 1, 1}}), "r", stream_of(left), "s", {}).interval_distance_decades);
}

// A disk of four sectors at 2000 deg/s with one ON event and half an OFF event per pixel and edge. Delays are
// `late_deg` plus up to 20 deg; an OFF event is early by the excess delay of the previous ON event.
Stream disk_events(double speed_deg_s, double late_deg, std::int64_t start_us = 0) {
  constexpr double kSpan_us = 120'000, kDegree = 3.14159265358979 / 180;
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(0, 1);
  std::vector<Event> events;
  for (int y = 0; y < 120; ++y)
    for (int x = 0; x < 120; ++x) {
      const double dx = x + 0.5 - 60, dy = 60 - (y + 0.5);
      if (std::hypot(dx, dy) > 50) continue;
      // The ON edge is at 30 deg at t = 0 and passes here every 180 deg.
      double first = (std::atan2(dy, dx) / kDegree - 30) * (speed_deg_s < 0 ? -1 : 1);
      first -= 180 * std::floor(first / 180) + 180;
      for (double edge = first; edge < 400; edge += 180) {
        const double late = 20 * unit(random), speed = std::abs(speed_deg_s) * 1e-6;
        const auto add = [&](double deg, int p) {
          const double t = deg / speed;
          if (t >= 0 && t < kSpan_us)
            events.push_back({static_cast<std::int64_t>(t) + start_us, static_cast<std::uint16_t>(x),
                              static_cast<std::uint16_t>(y), static_cast<std::uint8_t>(p)});
        };
        add(edge + late_deg + late, 1);
        if (unit(random) < 0.5) add(edge + 90 + late_deg + 20 - late, 0);
      }
    }
  std::stable_sort(events.begin(), events.end(), [](const Event& a, const Event& b) { return a.t_us < b.t_us; });
  return stream_of(std::move(events), 120, 120);
}

TEST(Compare, DelaysBehindADisksEdges) {
  for (const double speed : {2000.0, -2000.0}) {
    const Stream real = disk_events(speed, 10, 5000), sim = disk_events(speed, 17);
    CompareOptions options{.split_half = false};
    const double at_us = 5000 + 20'000, turned = speed * 1e-6 * 20'000;
    options.disk = TurningDisk{60, 60, 50, speed, 30 + turned, 30 + turned - (speed > 0 ? 90 : -90), at_us, 4};
    const DelayComparison d = *compare(real, "r", sim, "s", options).delays;
    for (const std::size_t p : {0, 1}) {
      EXPECT_NEAR(*d.earth_mover_deg[p], 7, 0.2) << speed << p;
      EXPECT_NEAR(*d.overlap[p], 13.0 / 20, 0.08);
      EXPECT_NEAR((*d.real.quantiles_deg[p])[1], 20, 0.5);
      EXPECT_NEAR((*d.sim.quantiles_deg[p])[2], 35, 0.5);
      EXPECT_NEAR(d.real.per_edge[p], p ? 1 : 0.5, 0.03);
    }
    EXPECT_LT(*d.real.pair_sd_deg, 0.1);  // the delays of a pair compensate each other
    const DelayComparison same = *compare(real, "r", real, "s", options).delays;
    EXPECT_EQ(*same.earth_mover_deg[0], 0);
    EXPECT_NEAR(*same.overlap[1], 1, 1e-12);
  }
  // With one polarity only, the values of the other are empty.
  Stream on = disk_events(2000, 10);
  std::erase_if(on.events, [](const Event& e) { return !e.p; });
  CompareOptions options;
  options.disk = TurningDisk{60, 60, 50, 2000, 32, -58, 1000, 4};
  const auto c = compare(disk_events(2000, 10), "r", on, "s", options);
  EXPECT_FALSE(c.delays->overlap[0]);
  EXPECT_FALSE(c.delays->sim.pair_sd_deg);
  EXPECT_TRUE(to_json(c)["delays"]["off"]["earth_mover_deg"].is_null());
  EXPECT_NEAR(*c.delays->overlap[1], 1, 0.01);  // the first event differs
  EXPECT_NE(error_of(disk_events(2000, 10), stream_of(random_events(10, 1)),
                     {.normalisation = Normalisation::eq16, .disk = options.disk})
                .find("sensor size"),
            std::string::npos);
}

// facts.md: the published arithmetic gives 35.0816 (16.4662 + 18.6154) and 1.96512, Eq. 16 in float 23.849 and 1.974.
TEST(Compare, ReproducesThePublishedNumbersOfTheRealRecording) {
  PECS_NEEDS_SHARED("data/peer/R_360_L_ESIM.dat");
  const auto real = events::read_all(tests::shared_dir() / "data/real/R_360_L.hdf5");
  const auto esim = events::read_all(tests::shared_dir() / "data/peer/R_360_L_ESIM.dat");
  const auto score = [&](Normalisation n) {
    return compare(real, "real", esim, "esim", {.normalisation = n, .window_us = 100'000}).distance;
  };
  const Distances paper = score(Normalisation::paper);
  EXPECT_NEAR(paper.chamfer(), 35.0816, 5e-5);
  EXPECT_NEAR(paper.chamfer_parts[0], 16.4662, 5e-5);
  EXPECT_NEAR(paper.chamfer_parts[1], 18.6154, 5e-5);
  EXPECT_NEAR(paper.gaussian(), 1.96512, 5e-6);
  const Distances eq16 = score(Normalisation::eq16);
  EXPECT_NEAR(eq16.chamfer(), 23.849, 5e-4);
  EXPECT_NEAR(eq16.gaussian(), 1.974, 5e-4);
}

TEST(Compare, ASingleEventHasNoFloor) {
  const auto one = stream_of({{5, 1, 1, 1}});
  const auto c = compare(one, "r", one, "s", {});
  EXPECT_EQ(c.distance.chamfer(), 0);
  EXPECT_FALSE(c.floor);
}

}  // namespace
}  // namespace pecs::metrics
