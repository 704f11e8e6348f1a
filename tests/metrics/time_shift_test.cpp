#include "pecs/metrics/time_shift.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "random_events.h"

namespace pecs::metrics {
namespace {

// A bar that rotates once in 40 ms with ON events before and OFF events behind it, delayed by `late_us`.
events::Recording bar(unsigned seed, double late_us, std::int64_t span_us) {
  auto events = tests::random_events(20'000, seed, 64, 48, span_us);
  for (auto& e : events) {
    const double turn = (static_cast<double>(e.t_us) - late_us) / 40'000 * 2 * std::numbers::pi;
    e.p = std::cos(std::atan2(e.y - 24, e.x - 32) - turn) > 0;
  }
  return events::recording_of({{64, 48, ""}, std::move(events)}, "x", 0, INT64_MAX);
}

TEST(TimeShift, FindsAKnownShiftBothWays) {
  for (const double late_us : {-6300.0, 0.0, 4100.0}) {
    const auto shift = time_shift(bar(1, 0, 50'000), bar(2, late_us, 50'000), 15'000);
    ASSERT_TRUE(shift);
    EXPECT_NEAR(shift->shift_us, late_us, 250) << late_us;
    EXPECT_GE(shift->correlation, shift->correlation_unshifted);
  }
}

TEST(TimeShift, StreamsOfDifferentLength) {
  const auto shift = time_shift(bar(1, 0, 60'000), bar(2, 3000, 35'000), 15'000);
  ASSERT_TRUE(shift);
  EXPECT_NEAR(shift->shift_us, 3000, 250);
}

TEST(TimeShift, NoiseHasNoSignificantShift) {
  const auto noise = [](unsigned seed) {
    return events::recording_of({{64, 48, ""}, tests::random_events(20'000, seed)}, "x", 0, INT64_MAX);
  };
  const auto shift = time_shift(noise(1), noise(2), 5000);
  ASSERT_TRUE(shift);
  EXPECT_LT(shift->correlation, 0.1);
}

TEST(TimeShift, TooFewEventsOrAnotherSensor) {
  EXPECT_FALSE(time_shift(events::recording_of({{64, 48, ""}, tests::random_events(50, 1)}, "x", 0, INT64_MAX),
                          bar(1, 0, 9000), 100));
  EXPECT_FALSE(time_shift(events::recording_of({{65, 48, ""}, tests::random_events(5000, 1)}, "x", 0, INT64_MAX),
                          bar(1, 0, 9000), 100));
}

}  // namespace
}  // namespace pecs::metrics
