#include "pecs/calibration/disk.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "pecs/error.h"
#include "random_events.h"
#include "shared.h"

namespace pecs::calibration {
namespace {

struct Truth {
  double x = 171.3, y = 118.6, radius = 95, speed_deg_s = 2100,
         on_edge_deg = 33;  // edge: at the middle of the recording
  int sectors = 4;
  bool slow = true;  // events start slowly and end at the next edge; otherwise they start at their own edge
  int count = 60'000, background = 2000;
};

constexpr std::int64_t kSpan_us = 50'000, kMiddle_us = kSpan_us / 2;

double difference(double a, double b, double period) { return std::abs(std::remainder(a - b, period)); }

// Events of a rotating disk, drawn from its geometry.
events::Recording recording(const Truth& truth, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  std::vector<events::Event> events;
  const double sector_deg = 360.0 / truth.sectors, direction = truth.speed_deg_s > 0 ? 1 : -1;
  while (events.size() < static_cast<std::size_t>(truth.count)) {
    const auto t_us = static_cast<std::int64_t>(unit(random) * static_cast<double>(kSpan_us));
    const int edge = static_cast<int>(unit(random) * truth.sectors);
    const double behind_deg = truth.slow ? sector_deg * std::sqrt(0.2 + 0.8 * unit(random))
                                         : std::fmod(-8 * std::log(1 - unit(random)), sector_deg);
    const double frame_deg = truth.on_edge_deg + edge * sector_deg - direction * behind_deg;
    const double angle = (frame_deg + truth.speed_deg_s * 1e-6 * static_cast<double>(t_us - kMiddle_us)) * M_PI / 180;
    const double r = truth.radius * std::sqrt(unit(random));
    const double x = truth.x + r * std::cos(angle), y = truth.y - r * std::sin(angle);
    if (x < 0 || y < 0 || x >= 320 || y >= 240) continue;
    // In both directions the edges of one polarity follow each other at increasing angles.
    events.push_back({t_us, static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), edge % 2 == 0});
  }
  for (const auto& e : tests::random_events(static_cast<std::size_t>(truth.background), seed + 1, 320, 240, kSpan_us))
    events.push_back(e);
  events.push_back({0, 0, 0, 0}), events.push_back({kSpan_us - 1, 0, 0, 0});  // the recording's extent
  return events::recording_of({{320, 240, ""}, std::move(events)}, "x.raw", 0, INT64_MAX);
}

void expect_found(const Truth& truth, const DetectedDisk& disk) {
  EXPECT_EQ(disk.sectors, truth.sectors);
  EXPECT_TRUE(disk.warnings.empty()) << disk.warnings[0];
  EXPECT_NEAR(disk.centre_x.value, truth.x, 0.5);
  EXPECT_NEAR(disk.centre_y.value, truth.y, 0.5);
  EXPECT_NEAR(disk.speed_deg_s.value, truth.speed_deg_s, 0.003 * std::abs(truth.speed_deg_s));
  const double period = 720.0 / truth.sectors;
  EXPECT_LT(difference(disk.on_edge_deg.value, truth.on_edge_deg, period), 0.6);
  EXPECT_LT(difference(disk.off_edge_deg.value, truth.on_edge_deg + period / 2, period), 0.6);
  EXPECT_NE(disk.on_starts_sharply, truth.slow);
  EXPECT_NEAR(disk.rim.size.width / 2, truth.radius, 1);
  EXPECT_NEAR(disk.rim.size.height / 2, truth.radius, 1);
  EXPECT_NEAR(disk.rim.center.x, truth.x, 0.5);
  EXPECT_NEAR(disk.rim.center.y, truth.y, 0.5);
  EXPECT_EQ(disk.phase_time_us, kMiddle_us);
}

TEST(Disk, SlowAndFastPixelsBothDirectionsAndManySectors) {
  for (const Truth& truth :
       {Truth{}, Truth{.speed_deg_s = -1500, .on_edge_deg = 77}, Truth{.slow = false},
        Truth{.speed_deg_s = -3000, .slow = false}, Truth{.x = 140, .sectors = 6}, Truth{.y = 130, .sectors = 2}}) {
    SCOPED_TRACE(testing::Message() << truth.sectors << " sectors, " << truth.speed_deg_s
                                    << (truth.slow ? " slow" : " fast"));
    expect_found(truth, find_disk(recording(truth, 1), "x.raw"));
  }
}

TEST(Disk, PartlyOutOfView) {  // 16 px from the centre, where the events' median is, another harmonic is stronger
  for (const auto& [x, y] : {std::pair{270.0, 190.0}, {260.0, 180.0}, {280.0, 150.0}, {50.0, 60.0}}) {
    const Truth truth{.x = x, .y = y, .sectors = 8, .slow = false};
    const DetectedDisk disk = find_disk(recording(truth, 1), "x.raw");
    EXPECT_EQ(disk.sectors, truth.sectors) << x;
    EXPECT_NEAR(disk.centre_x.value, x, 0.5);
    EXPECT_NEAR(disk.centre_y.value, y, 0.5);
    EXPECT_NEAR(disk.speed_deg_s.value, truth.speed_deg_s, 0.003 * truth.speed_deg_s);
  }
}

TEST(Disk, ErrorsAreWithinTheDeviations) {
  int within = 0;
  for (unsigned seed = 0; seed < 4; ++seed) {
    const Truth truth;
    const DetectedDisk d = find_disk(recording(truth, 10 + seed), "x.raw");
    within += std::abs(d.speed_deg_s.value - truth.speed_deg_s) < 4 * d.speed_deg_s.deviation;
    within += std::abs(d.centre_x.value - truth.x) < 4 * d.centre_x.deviation;
    within += std::abs(d.centre_y.value - truth.y) < 4 * d.centre_y.deviation;
  }
  EXPECT_GE(within, 10);  // of 12
}

TEST(Disk, NoiseIsAnErrorWithTheBestCandidate) {
  for (const auto& events : {tests::random_events(30'000, 1, 320, 240), tests::random_events(500, 1, 320, 240)}) {
    const events::Recording noise = events::recording_of({{320, 240, ""}, events}, "x.raw", 0, INT64_MAX);
    pecs::tests::expect_error([&] { find_disk(noise, "x.raw"); }, ExitCode::bad_input, "nothing found");
  }
}

// A bar: its right edge is ON, its left edge OFF.
TEST(Disk, MotionAlongALineIsAnError) {
  for (const double behind_px : {1.0, 4.0}) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> unit(0, 1);
    std::vector<events::Event> events;
    while (events.size() < 30'000) {
      const double part = unit(random), y = 240 * unit(random);
      const bool on = unit(random) < 0.5;
      const double x = (on ? 160 : 100) + 48 * part + behind_px * std::log(1 - unit(random));
      events.push_back({static_cast<std::int64_t>(part * kSpan_us), static_cast<std::uint16_t>(x),
                        static_cast<std::uint16_t>(y), on});
    }
    const events::Recording bar = events::recording_of({{320, 240, ""}, events}, "x.raw", 0, INT64_MAX);
    pecs::tests::expect_error([&] { find_disk(bar, "x.raw"); }, ExitCode::bad_input, "centre of rotation in view");
  }
}

// Dark spots on a bright disk, or a rotor of few blades.
TEST(Disk, ARotatingPatternWithoutSectorsIsAnError) {
  for (const int spots : {1, 3})
    for (const double width_deg : {12.0, 24.0}) {
      std::mt19937 random(2);
      std::uniform_real_distribution<double> unit(0, 1);
      std::vector<events::Event> events;
      while (events.size() < 40'000) {
        const auto t_us = static_cast<std::int64_t>(unit(random) * static_cast<double>(kSpan_us) * 4);
        const bool on = unit(random) < 0.5;  // the pixel brightens behind the spot
        const double behind_deg = -3 * std::log(1 - unit(random)) + (on ? width_deg : 0);
        const int spot = static_cast<int>(unit(random) * spots);  // 0, 40 and 80 degrees on
        const double angle = (40 * spot - behind_deg + 2100 * 1e-6 * static_cast<double>(t_us)) * M_PI / 180;
        const double r = 60 + 20 * unit(random);
        events.push_back({t_us, static_cast<std::uint16_t>(160 + r * std::cos(angle)),
                          static_cast<std::uint16_t>(120 - r * std::sin(angle)), on});
      }
      try {
        const DetectedDisk d =
            find_disk(events::recording_of({{320, 240, ""}, events}, "x.raw", 0, INT64_MAX), "x.raw");
        FAIL() << spots << " spots of " << width_deg << " deg: found a disk of " << d.sectors << " sectors";
      } catch (const Error& e) {
        EXPECT_EQ(e.code(), ExitCode::bad_input);
        const bool named = std::string(e.what()).find("of equal width") != std::string::npos;
        EXPECT_TRUE(named || spots > 1) << e.what();  // several spots may lack the coherence
      }
    }
}

TEST(Disk, StoppingOrReversingGivesAWarningOrAnError) {
  const events::Recording turning = recording({}, 5);
  for (const bool back : {false, true}) {
    events::Stream stream{{320, 240, ""}, {}};
    for (const auto& e : turning.events)
      if (e.t_us < kMiddle_us) {
        stream.events.push_back(e);
        if (back) stream.events.push_back({kSpan_us - e.t_us, e.x, e.y, static_cast<std::uint8_t>(1 - e.p)});
      }
    for (const auto& e : tests::random_events(2000, 9, 320, 240, kSpan_us)) stream.events.push_back(e);
    try {
      const DetectedDisk d = find_disk(events::recording_of(std::move(stream), "x.raw", 0, INT64_MAX), "x.raw");
      EXPECT_FALSE(d.warnings.empty()) << (back ? "turns back " : "stops ") << d.speed_deg_s.value;
    } catch (const Error& e) {
      EXPECT_NE(std::string(e.what()).find("nothing found"), std::string::npos);
    }
  }
}

// facts.md: 2098 deg/s, centre (956.8, 360.9), ON edge 28.6 deg and OFF edge 119.2 deg at t = 32000 us.
TEST(Disk, TheRealRecording) {
  PECS_NEEDS_SHARED("data/real/R_360_L.hdf5");
  const DetectedDisk d = find_disk(
      events::recording_of(events::read_all(tests::shared_dir() / "data/real/R_360_L.hdf5"), "R_360_L", 0, INT64_MAX),
      "R_360_L");
  EXPECT_EQ(d.sectors, 4);
  EXPECT_TRUE(d.warnings.empty()) << d.warnings[0];
  EXPECT_NEAR(d.speed_deg_s.value, 2098, 5);
  EXPECT_NEAR(d.centre_x.value, 956.8, 1);
  EXPECT_NEAR(d.centre_y.value, 360.9, 1);
  const double since_us = static_cast<double>(d.phase_time_us - 32'000);
  EXPECT_LT(difference(d.on_edge_deg.value - d.speed_deg_s.value * since_us * 1e-6, 28.6, 180), 1);
  EXPECT_LT(difference(d.off_edge_deg.value - d.speed_deg_s.value * since_us * 1e-6, 119.2, 180), 1);
  EXPECT_FALSE(d.on_starts_sharply);
  EXPECT_NEAR((d.rim.size.width + d.rim.size.height) / 4, 303, 3);
}

}  // namespace
}  // namespace pecs::calibration
