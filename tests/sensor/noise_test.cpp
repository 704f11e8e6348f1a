// Events that noise makes in still light, against first passages of the same process in double precision.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "clip.h"

namespace pecs::sensor {
namespace {

constexpr int kWidth = 192, kHeight = 192, kFrames = 121;
constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;
constexpr double kExposure = 0.2;  // of the photoreceptor from frame to frame: the noise's correlation is e^-0.2
constexpr double kDeviation = 0.03;

// By pixel. threshold: in standard deviations.
std::vector<double> counts_of_sensor(double threshold) {
  Chip chip = without_noise(load_chip("imx636"));
  chip.threshold_mismatch = chip.refractory_period_s = chip.dark_current_a = 0;
  chip.noise_std = kDeviation;
  chip.contrast_threshold_on = chip.contrast_threshold_off = threshold * kDeviation;
  const double a_per_us = 2 * std::numbers::pi * chip.corner_hz_per_a * 1e-21, h_us = 1000;
  const Clip clip =
      make_clip(kWidth, kHeight, kFrames, h_us, [&](int, int, double) { return kExposure / (a_per_us * h_us); });
  Sensor sensor(chip, kWidth, kHeight, 3, 1.0);
  std::vector<double> counts(kPixels);
  for (const events::Event& e : run_clip(sensor, clip, 64, 2)) ++counts[std::size_t{e.y} * kWidth + e.x];
  return counts;
}

std::vector<double> counts_of_first_passages(double threshold) {
  std::mt19937_64 random(4);
  std::normal_distribution<double> normal;
  const double correlation = std::exp(-kExposure), fresh = std::sqrt(1 - correlation * correlation);
  std::vector<double> counts(kPixels);
  for (double& count : counts) {
    double noise = normal(random), reference = noise;
    for (int frame = 1; frame < kFrames; ++frame) {
      noise = correlation * noise + fresh * normal(random);  // straight within an interval
      const double passed = std::trunc((noise - reference) / threshold);
      reference += passed * threshold;
      count += std::abs(passed);
    }
  }
  return counts;
}

struct Moments {
  double mean, variance;
};
Moments moments(const std::vector<double>& v) {
  double sum = 0, square = 0;
  for (const double x : v) sum += x, square += x * x;
  const double n = static_cast<double>(v.size()), mean = sum / n;
  return {mean, square / n - mean * mean};
}

}  // namespace

TEST(Noise, EventRatesAgainstFirstPassages) {
  for (const double threshold : {1.0, 3.0, 4.0, 5.0, 6.0}) {
    const Moments ours = moments(counts_of_sensor(threshold)), exact = moments(counts_of_first_passages(threshold));
    EXPECT_GT(exact.mean * kPixels, 5) << threshold;
    EXPECT_NEAR(ours.mean, exact.mean, 3 * std::sqrt((ours.variance + exact.variance) / kPixels)) << threshold;
  }
}

TEST(Noise, NeighboursAreIndependent) {
  const std::vector<double> counts = counts_of_sensor(2);
  const auto [mean, variance] = moments(counts);
  for (const std::size_t apart : {std::size_t{1}, std::size_t{2}, std::size_t{kWidth}, std::size_t{1024}}) {
    double sum = 0;
    for (std::size_t i = 0; i + apart < kPixels; ++i) sum += (counts[i] - mean) * (counts[i + apart] - mean);
    EXPECT_NEAR(sum / (variance * kPixels), 0, 4 / std::sqrt(static_cast<double>(kPixels))) << apart;
  }
}

}  // namespace pecs::sensor
