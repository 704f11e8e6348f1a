// Random numbers: the generator's published answers, and moments.
#include "pecs/sensor/random.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <vector>

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

// Pairs of deviates of the noise, of pixels near each other and of one pixel at different times, fill a square evenly:
// chi-square with 255 degrees of freedom. Four steps share a call. With PECS_LONG_TESTS in the environment, 10^8 of
// each.
TEST(Random, PixelsAndTimesAreIndependent) {
  constexpr std::uint32_t kSide = 16, kWidth = 1280, kWords = 4;
  const std::uint32_t pixels = std::getenv("PECS_LONG_TESTS") ? 1000 * 25000 : 250000;
  const auto words = [](std::uint32_t pixel, std::int64_t four) { return random4(1, pixel, four, Purpose::noise); };
  struct Other {
    const char* name;
    std::uint32_t pixel;
    std::int64_t step;
  };
  for (const auto& [name, pixel, step] : {Other{"next pixel", 1, 0},
                                          {"pixel below", kWidth, 0},
                                          {"next block", 4096, 0},
                                          {"next step", 0, 1},
                                          {"step after that", 0, 2},
                                          {"next call", 0, 4},
                                          {"next pixel, next step", 1, 1}}) {
    std::vector<double> seen(std::size_t{kSide} * kSide);
    for (std::uint32_t p = 0; p < pixels; ++p) {
      const std::int64_t four = p / (1u << 16);
      const Random4 a = words(p, four);
      const Random4 same = pixel ? words(p + pixel, four) : a, next = step ? words(p + pixel, four + 1) : same;
      for (std::uint32_t k = 0; k < kWords; ++k) {
        const auto other = k + static_cast<std::uint32_t>(step);
        const std::uint32_t b = other < kWords ? same[other] : next[other - kWords];
        ++seen[std::size_t{a[k] >> 28} * kSide + (b >> 28)];
      }
    }
    const double expected = double{kWords} * pixels / (kSide * kSide);
    double chi2 = 0;
    for (const double n : seen) chi2 += (n - expected) * (n - expected) / expected;
    EXPECT_NEAR(chi2, 255, 4 * std::sqrt(2 * 255)) << name;
    if (pixels > 1000000) std::printf("%s: chi-square %.1f of 255\n", name, chi2);
  }
}

TEST(Random, GaussianIsTheInverseOfTheNormalDistribution) {
  for (const double g : {-4.5, -3.0, -1.0, -0.1, 0.0, 0.5, 2.0, 4.0}) {
    const double probability = 0.5 * std::erfc(-g / std::sqrt(2));
    EXPECT_NEAR(gaussian(static_cast<std::uint32_t>(probability * 0x1p32)), g, 3e-4);
  }
}

}  // namespace pecs::sensor
