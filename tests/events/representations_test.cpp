// Representations of times of any size. tests/python/events/test_representations.py tests the formulas.
#include "pecs/events/representations.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <vector>

namespace pecs::events {
namespace {

constexpr std::int64_t kLeast = std::numeric_limits<std::int64_t>::min(),
                       kMost = std::numeric_limits<std::int64_t>::max();

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

}  // namespace
}  // namespace pecs::events
