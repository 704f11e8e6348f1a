// Representations: sums, limits and errors. tests/python/events/test_representations.py tests the formulas.
#include "pecs/events/representations.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <vector>

#include "pecs/error.h"

namespace pecs::events {
namespace {

constexpr std::int64_t kLeast = std::numeric_limits<std::int64_t>::min(),
                       kMost = std::numeric_limits<std::int64_t>::max();

TEST(Representations, EveryEventCountsOnce) {
  std::vector<Event> events;
  for (int i = 0; i < 1001; ++i)
    events.push_back({i, static_cast<std::uint16_t>(i % 7), static_cast<std::uint16_t>(i % 5), 1});
  for (const int bins : {1, 2, 3, 10, 64}) {
    const EventWindow window{7, 5, 0, 1000};
    std::vector<float> grid(static_cast<std::size_t>(bins) * 35, NAN), counts(2 * grid.size(), NAN);
    voxel_grid(events, window, bins, false, grid);
    event_histogram(events, window, bins, counts);
    EXPECT_NEAR(std::accumulate(grid.begin(), grid.end(), 0.0), 1001, 1e-3) << bins;
    EXPECT_EQ(std::accumulate(counts.begin(), counts.end(), 0.0), 1001) << bins;
    EXPECT_GT(std::accumulate(counts.end() - 35, counts.end(), 0.0), 1000.0 / bins) << "the end is in the last bin";
  }
}

TEST(Representations, TimesOfAnySize) {
  const std::vector<Event> events = {{kLeast, 0, 0, 1}, {-5, 0, 0, 0}, {7, 1, 0, 1}, {kMost, 1, 0, 1}};
  std::vector<float> out(4);
  for (const auto& [begin, end, count] : {std::tuple{-1e300, 1e300, 2},
                                          {-5.0, 7.0, 2},
                                          {-4.5, 7.0, 1},
                                          {1e300, 1e300, 0},
                                          {7.0, 7.0, 1},
                                          {6.25, 6.5, 0}}) {
    event_histogram(events, {2, 1, begin, end}, 1, out);
    EXPECT_EQ(std::accumulate(out.begin(), out.end(), 0.0), count) << begin;
    time_surface(events, {2, 1, begin, end}, 3, out);
    voxel_grid(events, {2, 1, begin, end}, 2, true, out);
    for (const float v : out) EXPECT_TRUE(std::isfinite(v)) << begin;
  }
}

TEST(Representations, WrongSizesAreRefused) {
  const std::vector<Event> events = {{0, 3, 2, 1}};
  std::vector<float> out(24);
  const EventWindow window{4, 3, 0, 1};
  EXPECT_NO_THROW(voxel_grid(events, window, 2, false, out));
  EXPECT_THROW(voxel_grid(events, {3, 4, 0, 1}, 2, false, out), Error);   // x
  EXPECT_THROW(voxel_grid(events, {12, 1, 0, 1}, 2, false, out), Error);  // y
  EXPECT_THROW(voxel_grid(events, window, 3, false, out), Error);
  EXPECT_THROW(voxel_grid(events, {4, 3, 1, 0}, 2, false, out), Error);
  EXPECT_THROW(voxel_grid(events, {4, 3, -INFINITY, 0}, 2, false, out), Error);
  EXPECT_THROW(event_histogram(events, window, 2, out), Error);
  EXPECT_THROW(event_histogram(events, window, 1 << 30, out), Error);
  EXPECT_THROW(time_surface(events, window, 0, out), Error);
}

}  // namespace
}  // namespace pecs::events
