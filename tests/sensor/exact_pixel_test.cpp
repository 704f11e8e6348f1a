// The text of the pixel's equations in double precision, against closed forms, and the sensor against it.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "clip.h"
#include "models/pecs/amplifier.h"
#include "models/pecs/noise.h"
// then: the equations above need no Highway
#include <hwy/targets.h>

#include "pecs/sensor/random.h"

namespace pecs::sensor {

using scalar::hermite, scalar::first_crossing, scalar::receptor_step;
using Cubic = scalar::Cubic<double>;
using Crossing = scalar::Crossing<double>;

TEST(Crossing, FirstOfSeveral) {
  const Cubic q{0, 3, -9, 6};  // rises to 0.289 at 0.211, falls to -0.289 at 0.789, ends at 0
  const Crossing up = first_crossing(q, 0.0, -0.2, 0.2);
  EXPECT_TRUE(up.on);
  EXPECT_NEAR(q.at(up.at), 0.2, 1e-7);
  EXPECT_LT(up.at, 0.211);
  const Crossing down = first_crossing(q, 0.0, -0.2, 0.3);
  EXPECT_FALSE(down.on);
  EXPECT_NEAR(q.at(down.at), -0.2, 1e-7);
  EXPECT_GT(first_crossing(q, 0.0, -0.3, 0.3).at, 1);
  EXPECT_GT(first_crossing(q, down.at + 1e-3, -0.3, 0.2).at, 1);
}

TEST(Crossing, EveryShapeAgainstADenseSearch) {
  int crossings = 0, flat = 0;  // flat: just before an extremum, where Halley's method stops early
  for (double m0 = -4; m0 <= 4; m0 += 0.5)
    for (double m1 = -4; m1 <= 4; m1 += 0.5)
      for (double v1 = -1; v1 <= 1; v1 += 0.25) {
        const Cubic q = hermite(0.0, v1, m0, m1);
        double dense = 2;
        for (int i = 0; i <= 20000 && dense > 1; ++i)
          if (std::abs(q.at(i / 20000.0)) >= 0.3) dense = i / 20000.0;
        const Crossing found = first_crossing(q, 0.0, -0.3, 0.3);
        if (dense <= 1) {
          ++crossings;
          flat += std::abs(found.at - dense) > 6e-5;
          ASSERT_NEAR(std::abs(q.at(found.at)), 0.3, 2e-3) << m0 << ' ' << m1 << ' ' << v1;
        } else if (found.at <= 1) {  // touched between two samples
          ASSERT_NEAR(std::abs(q.at(found.at)), 0.3, 1e-6);
        }
      }
  EXPECT_GT(crossings, 1000);
  EXPECT_LE(flat, 0.003 * crossings);
}

TEST(Photoreceptor, ConstantLightIsTheLogisticCurve) {
  for (const double x : {1e-6, 0.01, 0.3, 3.0, 40.0}) {
    const double light = 2.5, u0 = 0.2;
    const double u1 =
        light * u0 * std::exp(x) / (light + u0 * (std::exp(x) - 1));  // docs/reference/sensor.md, x = a I dt
    EXPECT_NEAR(1 / receptor_step(1 / u0, 1 / light, 1 / light, 0.0, 0.0, x), u1, 1e-7 * light);
  }
}

namespace {

// One pixel without noise, in double precision: the equations of the product, one crossing after another.
struct ReferencePixel {
  double a_per_us, b_per_us, leak_per_us, refractory_us, threshold_on, threshold_off;
  double w = 0;          // photoreceptor state 1/u
  double y = 0;          // amplifier
  double reference = 0;  // V or y at the last reset
  double blind_us = 0;   // time left until the reset

  struct Fired {
    double t_us;
    bool on;
  };

  // The interval from t0_us; light: ln I.
  void step(double t0_us, double h_us, const Cubic& light, std::vector<Fired>& events) {
    scalar::Photoreceptor<double> receptor{light, 2e-4f, a_per_us * h_us, 0, 0, 0, w, std::exp(light.c0), light.c1};
    receptor.bound();
    const double drift = leak_per_us * h_us;
    double s0 = 0;
    while (s0 < 1) {
      Cubic q = light;
      double s1 = 1;
      if (a_per_us > 0) {
        const double v0 = -std::log(receptor.w);
        const scalar::Amplifier<double> amplifier{b_per_us * h_us};
        const double longest = b_per_us > 0 ? amplifier.step_length(receptor, receptor.motion(), v0, y) : 1;
        const auto [ds, end, m0] = receptor.choose(receptor.motion(), longest);
        receptor.take(true, ds, end);
        receptor.s = s1 = end;
        const double v1 = -std::log(receptor.w), m1 = receptor.slope_of_v(receptor.motion(), ds);
        q = hermite(v0, v1, m0, m1);
        if (b_per_us > 0) {
          const auto step = amplifier.take(y, v0, v1, m0, m1, ds);
          q = step.y;
          y = step.end;
        }
      }
      q.c0 += drift * s0;
      q.c1 += drift * (s1 - s0);
      fire_within(q, t0_us, s0 * h_us, s1 * h_us, events);
      s0 = s1;
    }
    if (blind_us > 0) blind_us = std::max(blind_us - h_us, 1e-6);
    reference -= drift;
    w = receptor.w;
  }

 private:
  // q: V with the leak's drift between start and end [us] of the interval.
  void fire_within(const Cubic& q, double t0_us, double start, double end, std::vector<Fired>& events) {
    const double h = end - start;
    double s = 0;
    for (bool first = true;; first = false) {
      if (blind_us > 0) {
        if (blind_us >= end) return;
        s = std::max(0.0, (blind_us - start) / h);
        blind_us = 0;
        reference = q.at(s);
      } else if (!first) {
        reference = q.at(s);
      }
      const Crossing next = first_crossing(q, s, reference - threshold_off, reference + threshold_on);
      if (next.at > 1) return;
      s = next.at;
      events.push_back({t0_us + start + s * h, next.on});
      if (refractory_us > 0) blind_us = start + s * h + refractory_us;
    }
  }
};

// Slopes of ln I at the frames, per us.
std::vector<double> slopes(const std::vector<double>& l, const std::vector<double>& t_us) {
  const std::size_t n = l.size();
  const auto h = [&](std::size_t i) { return t_us[i + 1] - t_us[i]; };
  const auto chord = [&](std::size_t i) { return (l[i + 1] - l[i]) / h(i); };
  std::vector<double> m(n, 0.0);
  const double s0 = chord(0), s1 = chord(1), first = ((2 * h(0) + h(1)) * s0 - h(0) * s1) / (h(0) + h(1));
  if (first * s0 > 0) m[0] = s0 * s1 < 0 && std::abs(first) > 3 * std::abs(s0) ? 3 * s0 : first;
  for (std::size_t i = 1; i + 1 < n; ++i) {
    const double before = chord(i - 1), after = chord(i), share = h(i - 1) / (h(i - 1) + h(i));
    if (before * after == 0) continue;
    const double left = 2 * before - m[i - 1], three = (1 - share) * before + share * after;  // slopes of parabolas
    const double longest = std::max(h(i - 1), h(i)), even = std::min(h(i - 1), h(i)) / longest;
    const double bends[] = {left - before, three - before};
    double limit = 0.2 / longest;
    if (before * after > 0) limit = std::max(limit, 3 * std::min(std::abs(before), std::abs(after)));
    if (bends[0] * bends[1] > 0)
      limit = std::max(limit, std::min(2.0, 4 * even * even) * std::min(std::abs(bends[0]), std::abs(bends[1])));
    m[i] = std::clamp(0.9 * (1 - share) * left + (0.1 + 0.9 * share) * three, -limit, limit);
    if (before * after > 0 && m[i] * before < 0) m[i] = 0;
  }
  m[n - 1] = chord(n - 2);
  return m;
}

// Light that is constant, jumps or drifts at random, from dim to bright, with frames at irregular times.
void compare_with_double_precision() {
  const int pixels = 200, frames = 40;
  for (const std::vector<std::string>& changes :
       {std::vector<std::string>{},
        {"amplifier_cutoff_hz=0"},
        {"amplifier_cutoff_hz=150", "refractory_period_s=0.0004"},
        {"leak_rate_hz=20"},
        {"corner_hz_per_a=0", "amplifier_cutoff_hz=0", "refractory_period_s=0.0002", "leak_rate_hz=10"}}) {
    Chip chip = without_noise(load_chip("imx636"));
    chip.refractory_period_s = 3e-6;
    for (const std::string& change : changes) {
      const double value = std::stod(change.substr(change.find('=') + 1));
      if (change.starts_with("refractory")) chip.refractory_period_s = value;
      if (change.starts_with("leak")) chip.leak_rate_hz = value;
      if (change.starts_with("corner")) chip.corner_hz_per_a = value;
      if (change.starts_with("amplifier")) chip.amplifier_cutoff_hz = value;
    }
    Clip clip{pixels, 1, {}, {}};
    for (int i = 0; i < frames; ++i) {
      const auto random = [&](int x, int word) {
        const Random4 r = random4(7, static_cast<std::uint32_t>(x), i, Purpose::model);
        return uniform(r[static_cast<std::size_t>(word)]);
      };
      clip.t_us.push_back(i == 0 ? 0.25 : clip.t_us.back() + 200 + 2800 * random(0, 3));
      auto& frame = clip.frames.emplace_back();
      for (int x = 0; x < pixels; ++x) {
        const double base = 0.3 * std::pow(1e5, x / static_cast<double>(pixels));
        const double before = i == 0 ? base : clip.frames[static_cast<std::size_t>(i) - 1][static_cast<std::size_t>(x)];
        const bool rests = i > 0 && random(x / 16, 0) < 0.4;
        const double moved = std::clamp(
            before * std::exp(0.7 * gaussian(random4(9, static_cast<std::uint32_t>(x), i, Purpose::model)[0])),
            base / 9, base * 9);
        frame.push_back(static_cast<float>(rests ? before : moved));
      }
    }
    std::size_t disputed = 0;
    std::vector<double> errors_us;
    Sensor sensor(chip, pixels, 1, 1, 1.0);
    std::vector<std::vector<events::Event>> found(pixels);
    for (const events::Event& e : run_clip(sensor, clip, 9, 2)) found[e.x].push_back(e);

    for (std::size_t x = 0; x < found.size(); ++x) {
      std::vector<double> l;
      for (const auto& frame : clip.frames) l.push_back(std::log(double{frame[x]} + chip.dark_current_a * 1e15));
      const std::vector<double> m = slopes(l, clip.t_us);
      ReferencePixel pixel{2 * std::numbers::pi * chip.corner_hz_per_a * 1e-21,
                           2 * std::numbers::pi * chip.amplifier_cutoff_hz * 1e-6,
                           chip.leak_rate_hz * chip.contrast_threshold_on * 1e-6,
                           chip.refractory_period_s * 1e6,
                           chip.contrast_threshold_on,
                           chip.contrast_threshold_off};
      pixel.w = std::exp(-l[0]);
      pixel.y = pixel.reference = l[0];
      std::vector<ReferencePixel::Fired> expected;
      for (std::size_t i = 0; i + 1 < l.size(); ++i) {
        const double h = clip.t_us[i + 1] - clip.t_us[i];
        pixel.step(clip.t_us[i], h, hermite(l[i], l[i + 1], m[i] * h, m[i + 1] * h), expected);
      }
      // Light that only just reaches a threshold may or may not make an event; from there on the two differ.
      bool same = expected.size() == found[x].size();
      for (std::size_t k = 0; same && k < expected.size(); ++k) same = expected[k].on == (found[x][k].p == 1);
      disputed += !same;
      if (same)
        for (std::size_t k = 0; k < expected.size(); ++k)
          errors_us.push_back(std::abs(static_cast<double>(found[x][k].t_us) - expected[k].t_us));
    }
    SCOPED_TRACE(testing::PrintToString(changes));
    ASSERT_GT(errors_us.size(), 2400u);
    EXPECT_LE(disputed, 2u);
    std::ranges::sort(errors_us);
    const auto quantile = [&](double q) {
      return errors_us[static_cast<std::size_t>(q * static_cast<double>(errors_us.size()))];
    };
    // Behind an amplifier y has an error of 4e-4, and a slow one has flat crossings.
    const double slack = chip.amplifier_cutoff_hz == 150 ? 3.5 : 1;
    EXPECT_LT(quantile(0.5), 0.35 * slack);  // rounding to 1 us gives 0.25
    EXPECT_LT(quantile(0.9),
              3 * slack);  // flat crossings magnify the 2e-4 of V, and a refractory period passes errors on
    if (chip.corner_hz_per_a == 0) {
      EXPECT_LT(quantile(0.99), 1);
    }
  }
}

// Largest excess over the values at both ends of an interval, beyond kFreeOvershoot, relative to the largest change of
// three neighbouring intervals. values: at frames.
double worst_overshoot(const std::vector<double>& values, const std::vector<double>& t_us) {
  double worst = -1, m0 = 0;
  for (std::size_t i = 1; i + 2 < values.size(); ++i) {
    const double h0 = t_us[i] - t_us[i - 1], h1 = t_us[i + 1] - t_us[i];
    const double change0 = values[i] - values[i - 1], change1 = values[i + 1] - values[i];
    const double m1 = scalar::inner_slope(change0 / h0, change1 / h1, m0, SlopeWeights(h0, h1));
    const Cubic q = hermite(values[i - 1], values[i], m0 * h0, m1 * h0);
    const double before = i < 2 ? 0 : values[i - 1] - values[i - 2];
    const double largest = std::max({std::abs(before), std::abs(change0), std::abs(change1)});
    for (double s = 0.02; s < 1; s += 0.02) {
      const double over = std::max(q.at(s) - std::max(q.c0, values[i]), std::min(q.c0, values[i]) - q.at(s));
      if (largest > 0) worst = std::max(worst, (over - kFreeOvershoot) / largest);
      if (largest == 0) {
        EXPECT_EQ(over, 0);
      }
    }
    m0 = m1;
  }
  return worst;
}

}  // namespace

TEST(Slope, OvershootIsBoundedOnAnyFrames) {
  const auto random = [](std::size_t i, int word) {
    return random4(3, static_cast<std::uint32_t>(i), 0, Purpose::model)[static_cast<std::size_t>(word)];
  };
  for (const double uneven : {0.0, 0.9}) {
    std::vector<double> t_us{0}, white{0}, walk{0}, steps{0}, noisy{0};
    for (std::size_t i = 1; i < 20000; ++i) {
      t_us.push_back(t_us.back() + 1000 * (1 + uneven * (2 * uniform(random(i, 0)) - 1)));
      white.push_back(gaussian(random(i, 1)));
      walk.push_back(walk.back() + white.back());
      steps.push_back(steps.back() + (uniform(random(i, 2)) < 0.1 ? 1.5 * white.back() : 0));
      noisy.push_back(steps.back() + 0.01 * gaussian(random(i, 3)));
    }
    for (const auto* frames : {&white, &walk, &steps, &noisy}) EXPECT_LT(worst_overshoot(*frames, t_us), 0.12);
  }
  // A step between still frames: none at all.
  std::vector<double> t_us, step;
  for (int i = 0; i < 20; ++i) t_us.push_back(1000 * i), step.push_back(i / 7);
  EXPECT_LE(worst_overshoot(step, t_us), -kFreeOvershoot);
}

TEST(Slope, ParabolasAreExactAtAnySpacing) {
  double t = 0, m = 3;
  const auto value = [](double at) { return 3 * at - 0.7 * at * at; };
  for (const double h : {1.0, 0.8, 1.1, 1.3, 0.9, 1.0, 1.2}) {
    const double end = t + h, h1 = 1.05;
    m = scalar::inner_slope((value(end) - value(t)) / h, (value(end + h1) - value(end)) / h1, m, SlopeWeights(h, h1));
    EXPECT_NEAR(m, 3 - 1.4 * end, 1e-5);
    t = end;
  }
}

// The density of upward crossings of a level at u on the way between two states, by Rice's formula for their law there.
double crossing_density(double x, double y, double u, const scalar::NoiseState<double> (&ends)[2], double level) {
  const auto law = scalar::noise_between(scalar::noise_step(x * u, y * u), scalar::noise_step(x - x * u, y - y * u),
                                         ends[0], ends[1], false);
  const double per_zz = law.spread.nz / law.spread.zz, zz = 2 * x * law.spread.zz, off = level - law.mean.z;
  const double std = y * std::sqrt(2 * x * (law.spread.nn - per_zz * law.spread.nz));
  const double a = y * (law.mean.n + per_zz * off - level) / std;
  const double upwards =
      std::exp(-a * a / 2) / std::sqrt(2 * std::numbers::pi) + a * 0.5 * std::erfc(-a / std::sqrt(2));
  return std * upwards * std::exp(-off * off / (2 * zz)) / std::sqrt(2 * std::numbers::pi * zz);
}

TEST(Noise, ExpectedCrossingsAreBounded) {
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  int compared = 0, exceeded = 0;
  for (int i = 0; i < 20'000; ++i) {
    const double y = std::pow(10, -1 + 4.0 * (i % 97) / 96), x = y * std::pow(10, -3.5 + 5.0 * (i % 89) / 88);
    const double share = y / (x + y), n0 = normal(random);
    const scalar::NoiseState<double> start{n0, share * n0 + std::sqrt(share - share * share) * normal(random)};
    const auto step = scalar::noise_step(x, y);
    const double g0 = normal(random), g1 = normal(random);
    // Free: the state after the first step.
    const scalar::NoiseState<double> ends[] = {start, scalar::draw_between(step, step, start, {}, true, 1.0, g0, g1)};
    const auto reach = scalar::noise_reach(x, y, 1.0);
    for (const double stds : {1.3, 2.0, 3.5, 5.0}) {
      const double distance = stds * reach.std, most = scalar::most_crossings(distance, 0.0, reach);
      if (most >= 0.25) continue;  // such a part is split (active_pixels-inl.h)
      double highest = 0;
      for (double u = 0.05; u < 1; u += 0.1)
        highest = std::max(highest, crossing_density(x, y, u, ends, reach.bounds(ends[0], ends[1]).above + distance));
      ++compared;
      exceeded += highest > most;
      EXPECT_LT(highest, 1.5 * most) << x << ' ' << y << ' ' << stds;
    }
  }
  EXPECT_GT(compared, 30'000);
  EXPECT_LT(exceeded, 0.001 * compared);
}

// On every instruction set that this machine supports (Highway).
TEST(Pixel, AgainstDoublePrecision) {
  const std::int64_t all = hwy::SupportedTargets();
  for (std::int64_t left = all; left != 0; left &= left - 1) {
    const std::int64_t target = left & -left;
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(target);
    SCOPED_TRACE(hwy::TargetName(target));
    compare_with_double_precision();
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(all);
}

}  // namespace pecs::sensor
