// Random numbers: the generator's published answers, and moments.
#include "pecs/sensor/random.h"

#include <gtest/gtest.h>

namespace pecs::sensor {

TEST(Random, PhiloxKnownAnswers) {  // kat_vectors of Random123
  EXPECT_EQ(philox<7>({0, 0, 0, 0}, 0), (Random4{0x5f6fb709, 0x0d893f64, 0x4f121f81, 0x4f730a48}));
  EXPECT_EQ(philox<10>({0, 0, 0, 0}, 0), (Random4{0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}));
}

TEST(Random, GaussianMoments) {
  double sum = 0, square = 0, fourth = 0;
  const int n = 400000;
  for (int i = 0; i < n / 4; ++i)
    for (const std::uint32_t r : random4(3, static_cast<std::uint32_t>(i), 7, Purpose::noise)) {
      const double g = gaussian(r);
      sum += g;
      square += g * g;
      fourth += g * g * g * g;
    }
  EXPECT_NEAR(sum / n, 0, 4 / std::sqrt(n));
  EXPECT_NEAR(square / n, 1, 4 * std::sqrt(2.0 / n));
  EXPECT_NEAR(fourth / n, 3, 4 * std::sqrt(96.0 / n));
}

TEST(Random, GaussianIsTheInverseOfTheNormalDistribution) {
  for (const double g : {-4.5, -3.0, -1.0, -0.1, 0.0, 0.5, 2.0, 4.0}) {
    const double probability = 0.5 * std::erfc(-g / std::sqrt(2));
    EXPECT_NEAR(gaussian(static_cast<std::uint32_t>(probability * 0x1p32)), g, 3e-4);
  }
}

}  // namespace pecs::sensor
