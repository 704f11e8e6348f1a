// Events that noise makes in still light, against first passages of the same process in double precision. With
// PECS_LONG_TESTS in the environment, more of the rare ones.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <numeric>
#include <random>
#include <vector>

#include "clip.h"

namespace pecs::sensor {
namespace {

constexpr int kWidth = 192, kHeight = 192, kFrames = 121;
constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;
constexpr double kExposure = 0.2;  // of the photoreceptor from frame to frame: the noise's correlation is e^-0.2
constexpr double kDeviation = 0.03;

bool long_tests() { return std::getenv("PECS_LONG_TESTS") != nullptr; }

// thresholds: in standard deviations. exposure: of the photoreceptor from frame to frame; amplifier: 2 pi its cutoff
// times the same, 0: none.
class StillSensor {
 public:
  StillSensor(int width, int height, double threshold, double exposure, double amplifier = 0, std::uint64_t seed = 3)
      : sensor_(chip(threshold, amplifier), width, height, seed, 1.0) {
    const double a_per_us = 2 * std::numbers::pi * chip(threshold, amplifier).corner_hz_per_a * 1e-21;
    plane_.assign(static_cast<std::size_t>(width) * static_cast<std::size_t>(height),
                  static_cast<float>(exposure / (a_per_us * kFrame_us)));
  }
  // Events of the next frames.
  LabelledEvents run(int frames, bool last) {
    LabelledEvents events;
    tbb::task_arena arena(2);
    arena.execute([&] {
      for (int left = frames; left > 0;) {
        const int now = std::min(left, 64);
        const std::vector<const float*> planes(static_cast<std::size_t>(now), plane_.data());
        std::vector<double> t_us;
        for (int i = 0; i < now; ++i) t_us.push_back(kFrame_us * frame_++);
        left -= now;
        sensor_.push(planes, t_us, last && left == 0, events);
      }
    });
    return events;
  }
  static constexpr double kFrame_us = 1000;

 private:
  static Chip chip(double threshold, double amplifier) {
    Chip chip = without_noise(load_chip("imx636"));
    chip.amplifier_cutoff_hz = amplifier / (2 * std::numbers::pi * kFrame_us * 1e-6);
    chip.threshold_mismatch = chip.refractory_period_s = chip.dark_current_a = 0;
    chip.noise_std = kDeviation;
    chip.contrast_threshold_on = chip.contrast_threshold_off = threshold * kDeviation;
    return chip;
  }

  Sensor sensor_;
  std::vector<float> plane_;
  double frame_ = 0;
};

// By pixel.
std::vector<double> counts_of_sensor(double threshold) {
  std::vector<double> counts(kPixels);
  for (const events::Event& e : StillSensor(kWidth, kHeight, threshold, kExposure).run(kFrames, true).events)
    ++counts[std::size_t{e.y} * kWidth + e.x];
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

// Expected events of a pixel from frame to frame, the sum over `frames` intervals: the density of noise and reference
// is stepped on a grid. The threshold is a multiple of the grid's step, and noise lies at the middle of its cells, so
// that a cell crosses as a whole; what is left is 1 % at 8 standard deviations.
double expected_events(double threshold, int frames) {
  constexpr double kStep = 0.1, kEnd = 8;
  const auto half = static_cast<int>(kEnd / kStep), cells = 2 * half, band = static_cast<int>(6 / kStep);
  const auto jump = static_cast<int>(std::lround(threshold / kStep));
  const double correlation = std::exp(-kExposure), variance = 1 - correlation * correlation;
  const auto noise_of = [&](int cell) { return (cell + 0.5) * kStep - kEnd; };
  const auto bell = [](double x, double v) { return std::exp(-0.5 * x * x / v) / std::sqrt(2 * std::numbers::pi * v); };
  // References lie on the cells' edges; [reference][noise].
  std::vector<std::vector<double>> density(static_cast<std::size_t>(cells + 1));
  for (int r = 0; r <= cells; ++r)
    for (int n = 0; n < cells; ++n) {
      const double reference = r * kStep - kEnd;
      density[static_cast<std::size_t>(r)].push_back(bell(reference, 1) * kStep *
                                                     bell(noise_of(n) - correlation * reference, variance) * kStep);
    }
  std::vector<std::vector<double>> moved(static_cast<std::size_t>(cells));  // from a cell: to its band
  for (int n = 0; n < cells; ++n)
    for (int to = 0; to < cells; ++to)
      moved[static_cast<std::size_t>(n)].push_back(bell(noise_of(to) - correlation * noise_of(n), variance) * kStep);
  double events = 0;
  for (int frame = 1;; ++frame) {
    auto next = std::vector(density.size(), std::vector<double>(static_cast<std::size_t>(cells)));
    for (int r = 0; r <= cells; ++r)
      for (int n = 0; n < cells; ++n) {
        const double here = density[static_cast<std::size_t>(r)][static_cast<std::size_t>(n)];
        const int passed = n >= r ? (n - r) / jump : -((r - n - 1) / jump);
        events += std::abs(passed) * here;
        const int reference = std::clamp(r + passed * jump, 0, cells),
                  middle = static_cast<int>(correlation * (n - half)) + half;
        if (here < 1e-18) continue;
        for (int to = std::max(0, middle - band); to < std::min(cells, middle + band); ++to)
          next[static_cast<std::size_t>(reference)][static_cast<std::size_t>(to)] +=
              here * moved[static_cast<std::size_t>(n)][static_cast<std::size_t>(to)];
      }
    if (frame == frames) return events;
    density = std::move(next);
  }
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

// Too rare to be drawn: against the density of noise and reference.
TEST(Noise, RareEventRatesAgainstTheDensity) {
  for (const double threshold : {3.0, 5.0}) {  // the density's own check
    const Moments drawn = moments(counts_of_first_passages(threshold));
    EXPECT_NEAR(expected_events(threshold, kFrames - 1), drawn.mean, 3 * std::sqrt(drawn.variance / kPixels))
        << threshold;
  }
  struct Run {
    double threshold;
    int side, frames;
  };
  std::vector<Run> runs{{7, 512, kFrames}};
  if (long_tests()) runs = {{7, 1024, 961}, {8, 2048, 1921}};
  for (const auto& [threshold, side, frames] : runs) {
    const double pixels = double{1} * side * side, expected = pixels * expected_events(threshold, frames - 1);
    const auto seen =
        static_cast<double>(StillSensor(side, side, threshold, kExposure).run(frames, true).events.size());
    EXPECT_GT(expected, 10);
    EXPECT_NEAR(seen, expected, 3 * std::sqrt(expected) + 0.01 * expected) << threshold;
    if (long_tests()) std::printf("%g deviations: %g events, %g expected\n", threshold, seen, expected);
  }
}

// Fine thresholds tell the noise at every frame, less what it was at the start: D(j), the mean square of its change
// over j frames, is 2 variance (1 - correlation(j)). With rates r of the photoreceptor and b of the amplifier, the
// variance is b / (b + r) and the correlation (b e^-rt - r e^-bt) / (b - r).
TEST(Noise, VarianceAndAutocorrelationAreThoseOfBothPoles) {
  constexpr int kSide = 48, kLength = 121;
  constexpr double kThreshold = 0.02;  // standard deviations
  struct Case {
    double exposure, amplifier, error;  // error: of the correlation, in coarse steps (docs/reference/sensor.md)
  };
  for (const auto& [exposure, amplifier, error] : {Case{0.05, 0, 0},
                                                   {0.3, 0, 0},
                                                   {1.0, 0, 0},
                                                   {0.05, 0.08, 0},
                                                   {0.15, 0.03, 0},
                                                   {0.1, 2, 0.02},
                                                   {2, 0.1, 0.02},
                                                   {0.7, 0.9, 0.07},
                                                   {3, 3.1, 0.23},
                                                   {20, 30, 0.04}}) {
    const auto events = StillSensor(kSide, kSide, kThreshold, exposure, amplifier).run(kLength, true).events;
    std::vector<std::vector<double>> v(std::size_t{kSide} * kSide, std::vector<double>(kLength));  // [pixel][frame]
    auto last = v;
    for (const events::Event& e : events) {
      const std::size_t pixel = std::size_t{e.y} * kSide + e.x, frame = static_cast<std::size_t>((e.t_us + 999) / 1000);
      last[pixel][frame] = e.p ? kThreshold : -kThreshold;
      v[pixel][frame] += last[pixel][frame];
    }
    for (std::size_t pixel = 0; pixel < v.size(); ++pixel) {
      std::partial_sum(v[pixel].begin(), v[pixel].end(), v[pixel].begin());
      for (std::size_t k = 1; k < kLength; ++k) {
        if (last[pixel][k] == 0) last[pixel][k] = last[pixel][k - 1];
        v[pixel][k] += last[pixel][k] / 2;  // where V stopped behind its last threshold
      }
    }
    for (const std::size_t apart : {1u, 2u, 5u, 20u, 60u}) {
      std::vector<double> squares;  // of each pixel, which is independent of the others
      for (const auto& of_pixel : v) {
        double sum = 0;
        for (std::size_t k = 0; k + apart < kLength; ++k) sum += std::pow(of_pixel[k + apart] - of_pixel[k], 2);
        squares.push_back(sum / static_cast<double>(kLength - apart));
      }
      const Moments d = moments(squares);
      const double of_v = std::exp(-exposure * static_cast<double>(apart)),
                   of_y = std::exp(-amplifier * static_cast<double>(apart));
      const double variance = amplifier > 0 ? amplifier / (amplifier + exposure) : 1;
      const double correlation = amplifier > 0 ? (amplifier * of_v - exposure * of_y) / (amplifier - exposure) : of_v;
      EXPECT_NEAR(d.mean, 2 * variance * (1 - correlation),
                  3 * std::sqrt(d.variance / static_cast<double>(squares.size())) + 2 * kThreshold * kThreshold +
                      2 * variance * (apart < 20 ? error : 0))
          << exposure << " " << amplifier << " " << apart;
    }
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
