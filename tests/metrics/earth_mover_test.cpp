#include "pecs/metrics/earth_mover.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

namespace pecs::metrics {
namespace {

TEST(EarthMover, OfHistogramsIsTheirShift) {
  const std::vector<double> a = {0, 4, 2, 0, 0}, b = {0, 0, 2, 1, 0};  // the same shape, a bin later
  EXPECT_NEAR(earth_mover(a, b, 2.5), 2.5, 1e-12);
  EXPECT_EQ(earth_mover(a, a, 1), 0);
  EXPECT_NEAR(earth_mover(std::vector<double>{1, 0, 0}, std::vector<double>{0, 0, 7}, 1), 2, 1e-12);
}

TEST(EarthMover, OfSamplesIsTheMeanDifferenceOfTheSorted) {
  std::mt19937 random(1);
  std::normal_distribution<float> normal;
  std::vector<float> a(500), b(500);
  for (auto* v : {&a, &b}) {
    for (float& x : *v) x = normal(random);
    std::sort(v->begin(), v->end());
  }
  double mean = 0;
  for (std::size_t i = 0; i < a.size(); ++i) mean += std::abs(a[i] - b[i]) / 500.0;
  EXPECT_NEAR(earth_mover_of_sorted(a, b), mean, 1e-6);
  std::vector<float> twice;
  for (const float x : a) twice.insert(twice.end(), {x, x});
  EXPECT_NEAR(earth_mover_of_sorted(a, twice), 0, 1e-9);
  EXPECT_NEAR(earth_mover_of_sorted(std::vector<float>{1}, std::vector<float>{3, 5}), 3, 1e-9);
}

}  // namespace
}  // namespace pecs::metrics
