#pragma once
// The law of a pixel's events (docs/reference/sensor.md, Photoreceptor to Pixel) in fixed steps of 1 us and double
// precision, to judge the kernel: nothing in here is the product's. Light is a function of time; photoreceptor,
// amplifier and noise make exact steps of constant light, and output is linear within a step.
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "pecs/sensor/chip.h"

namespace pecs::sensor::law {

using Light = std::function<double(double)>;  // photo- plus dark current [fA] over time [us]

struct Fired {
  double t_us;
  bool on;
};
using Events = std::vector<std::vector<Fired>>;  // by pixel

// Noise over a step (n: of the photoreceptor, z: behind the amplifier): n -> n_n n + s_n g, z -> z_n n + z_z z + s_zn g
// + s_zz g', with independent normal deviates g and g'.
struct NoiseStep {
  double n_n, z_n, z_z, s_n, s_zn, s_zz;
};

// dn = -r n dt + sqrt(q) dW, z' = b (n - z), for h.
inline NoiseStep noise_step(double r, double q, double b, double h) {
  if (std::abs(r - b) < 1e-4 * b) r = b * (1 + 1e-4);  // the closed form below divides by b - r
  const double e = std::exp(-r * h), f = std::exp(-b * h), c = b / (b - r);
  const auto mean = [h](double rate) { return -std::expm1(-rate * h) / rate; };  // integral of exp(-rate t)
  const double nn = q * mean(2 * r), nz = q * c * (mean(2 * r) - mean(r + b));
  const double zz = q * c * c * (mean(2 * r) - 2 * mean(r + b) + mean(2 * b));
  const double s_n = std::sqrt(nn), s_zn = nn > 0 ? nz / s_n : 0;
  return {e, c * (e - f), f, s_n, s_zn, std::sqrt(std::max(0.0, zz - s_zn * s_zn))};
}

struct Step {
  NoiseStep noise;
  double y;  // amplifier's output without noise at the step's end
};

// Photoreceptor and amplifier, from rest in the first light: of all pixels that see this light.
inline std::vector<Step> path_of(const Chip& chip, const Light& light, std::size_t steps, double h_us = 1) {
  const double a = 2e-21 * std::numbers::pi * chip.corner_hz_per_a,
               b = 2e-6 * std::numbers::pi * chip.amplifier_cutoff_hz;
  std::vector<Step> path;
  double u = light(0), y = std::log(u);
  for (std::size_t k = 0; k < steps; ++k) {
    const double i = light((static_cast<double>(k) + 0.5) * h_us), before = u, grown = std::expm1(a * i * h_us);
    u = std::isinf(grown) ? i : i * u * (1 + grown) / (i + u * grown);  // du/dt = a u (i - u)
    const double v = std::log(u), slope = (v - std::log(before)) / h_us, middle = std::sqrt(before * u);
    y = v - slope / b + (y - std::log(before) + slope / b) * std::exp(-b * h_us);  // y' = b (V - y), V straight
    const double q = chip.noise_std * chip.noise_std * a * (i + middle);
    path.push_back({noise_step(a * middle, q, b, h_us), y});
  }
  return path;
}

// Normal deviates: the middles of 4096 equal shares of the distribution, scaled to variance 1. The sums over many steps
// are what counts.
class Deviates {
 public:
  explicit Deviates(std::uint64_t seed) : words_(seed) {
    double square = 0;
    for (std::size_t i = 0; i < kShares; ++i) {
      double low = -9, high = 9;
      while (high - low > 1e-9) {
        const double x = (low + high) / 2;
        (std::erfc(-x / std::numbers::sqrt2) / 2 * kShares < static_cast<double>(i) + 0.5 ? low : high) = x;
      }
      square += low * low;
      table_[i] = low;
    }
    for (double& x : table_) x /= std::sqrt(square / kShares);
  }
  // Four of them.
  void next(double* to) {
    std::uint64_t word = words_();
    for (int i = 0; i < 4; ++i, word >>= 16) to[i] = table_[word % kShares];
  }
  std::mt19937_64& words() { return words_; }

 private:
  static constexpr std::size_t kShares = 4096;
  std::mt19937_64 words_;
  std::array<double, kShares> table_;
};

// A pixel's comparators, over steps in which the value is straight.
struct Comparators {
  double on, off, refractory_us, reference = 0, blind_until_us = -1;
  double low = 0, high = 0;  // where there is something to do

  void reset(double value) {
    reference = value;
    blind_until_us = -1;
    low = value - off;
    high = value + on;
  }
  void step(double t0_us, double h_us, double v0, double v1, std::vector<Fired>& events) {
    for (double t = t0_us;;) {
      const auto value = [&](double at_us) { return v0 + (v1 - v0) * (at_us - t0_us) / h_us; };
      if (blind_until_us >= 0) {
        if (blind_until_us > t0_us + h_us) return;
        t = std::max(t, blind_until_us);
        reset(value(t));
      }
      const double level = v1 >= high ? high : low;
      if (v1 < high && v1 > low) return;
      t = std::max(t, t0_us + (level - v0) / (v1 - v0) * h_us);
      events.push_back({t, level == high});
      blind_until_us = t + refractory_us;
      low = std::numeric_limits<double>::infinity();  // every step
    }
  }
};

// Pixels in groups that see the same light, each group `shift_us` later than the one before; each group's pixels are at
// rest before. Pixel p belongs to group p % groups.
inline Events simulate(const Chip& chip, const std::vector<Step>& path, std::size_t pixels, std::uint64_t seed,
                       std::size_t groups = 1, std::size_t shift = 0, double h_us = 1) {
  constexpr std::size_t kLanes = 8;
  Deviates deviates(seed);
  std::normal_distribution<double> normal;
  const double leak = chip.leak_rate_hz * chip.contrast_threshold_on * 1e-6 * h_us;
  const double first_light_y = path[0].y;
  // Stationary: <nn> = sigma^2, <nz> = <zz> = sigma^2 b / (b + r).
  const double s = chip.noise_std, b_share = [&] {
    const NoiseStep& step = path[0].noise;
    const double r = -std::log(step.n_n), b = -std::log(step.z_z);
    return b / (b + r);
  }();
  Events events(pixels);
  for (std::size_t block = 0; block * kLanes < pixels; ++block) {
    double n[kLanes], z[kLanes], v[kLanes], g[2 * kLanes];
    Comparators comparators[kLanes];
    std::vector<Fired>* out[kLanes];
    const std::size_t group = block % groups;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const auto threshold = [&](double nominal) {
        return nominal * std::max(0.1, 1 + chip.threshold_mismatch * normal(deviates.words()));
      };
      n[lane] = s * normal(deviates.words());
      z[lane] = b_share * n[lane] + s * std::sqrt(b_share - b_share * b_share) * normal(deviates.words());
      v[lane] = first_light_y + z[lane];
      const double on = threshold(chip.contrast_threshold_on), off = threshold(chip.contrast_threshold_off);
      comparators[lane] = {on, off, chip.refractory_period_s * 1e6};
      comparators[lane].reset(v[lane]);
      out[lane] = &events[group + groups * (kLanes * (block / groups) + lane)];
    }
    for (std::size_t k = 0; k < path.size(); ++k) {
      const Step& step = path[k < group * shift ? 0 : k - group * shift];
      const NoiseStep& m = step.noise;
      const double y = step.y + leak * static_cast<double>(k + 1);
      for (std::size_t i = 0; i < 2 * kLanes; i += 4) deviates.next(g + i);
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        z[lane] = m.z_n * n[lane] + m.z_z * z[lane] + m.s_zn * g[lane] + m.s_zz * g[kLanes + lane];
        n[lane] = m.n_n * n[lane] + m.s_n * g[lane];
        const double v1 = y + z[lane];
        Comparators& c = comparators[lane];
        if (v1 >= c.high || v1 <= c.low) c.step(h_us * static_cast<double>(k), h_us, v[lane], v1, *out[lane]);
        v[lane] = v1;
      }
    }
  }
  return events;
}

}  // namespace pecs::sensor::law
