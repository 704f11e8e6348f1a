// The law of the events, and that it does not depend on how finely light is sampled: the kernel with planes 10 ms to
// 25 us apart against law_reference.h, in two-sample tests. Each test takes kSignificance for all of its comparisons
// together (Bonferroni). With PECS_LONG_TESTS in the environment: more pixels, the chips' own thresholds in still
// light, rare events, and a table of all comparisons.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <numbers>
#include <numeric>
#include <string>
#include <vector>

#include "clip.h"
#include "law_reference.h"

namespace pecs::sensor {
namespace {

using law::Events, law::Light;

constexpr double kSignificance = 2e-4;
constexpr std::size_t kGroups = 8;  // neighbours that see the same light, one after another
const std::vector<double> kSpacings_us{10'000, 2'000, 500, 100, 25};

bool long_tests() { return std::getenv("PECS_LONG_TESTS") != nullptr; }

// Without what is independent of light: background events (tests/python/sensor/test_recording.py), hot pixels.
Chip noisy(const std::string& name) {
  Chip chip = load_chip(name);
  if (chip.amplifier_cutoff_hz == 0) chip.amplifier_cutoff_hz = 3000;  // profiles without one
  chip.background_on_hz = chip.background_off_hz = chip.hot_pixel_fraction = 0;
  return chip;
}

// Standard deviation of what the comparators see, in light of so many fA.
double deviation(const Chip& chip, double light_fa) {
  const double corner_hz = chip.corner_hz_per_a * light_fa * 1e-15;
  return chip.noise_std * std::sqrt(chip.amplifier_cutoff_hz / (chip.amplifier_cutoff_hz + corner_hz));
}

struct Case {
  std::string name;
  Chip chip;
  Light light_fa;                           // photo- plus dark current over time [us]
  double duration_us;                       // whole multiple of all spacings
  double shift_us = 0;                      // of the light from group to group
  bool is_even = false;                     // no phase is special: still light, or an exponential ramp
  double finest_us = 0, coarsest_us = 1e9;  // spacings that sample this light well enough
  std::vector<double> corners_us = {};      // times of planes in addition
};

// By pixel; times rounded to 1 us, as the product's.
Events of_kernel(const Case& c, double spacing_us, std::size_t pixels, std::uint64_t seed) {
  Clip clip{static_cast<int>(pixels / 16), 16, {}, c.corners_us};
  for (double t = 0; t <= c.duration_us; t += spacing_us) clip.t_us.push_back(t);
  std::ranges::sort(clip.t_us);
  const auto repeated = std::ranges::unique(clip.t_us);
  clip.t_us.erase(repeated.begin(), repeated.end());
  for (const double t_us : clip.t_us) {
    float values[kGroups];
    for (std::size_t g = 0; g < kGroups; ++g)
      values[g] = static_cast<float>(c.light_fa(std::max(0.0, t_us - static_cast<double>(g) * c.shift_us)) -
                                     c.chip.dark_current_a * 1e15);
    auto& frame = clip.frames.emplace_back(pixels);
    for (std::size_t p = 0; p < pixels; ++p) frame[p] = values[p % kGroups];
  }
  Sensor sensor(c.chip, clip.width, clip.height, seed, 1.0);
  Events events(pixels);
  for (const events::Event& e : run_clip(sensor, clip, 64, 2))
    events[std::size_t{e.y} * static_cast<std::size_t>(clip.width) + e.x].push_back(
        {static_cast<double>(e.t_us), e.p == 1});
  return events;
}

Events of_reference(const Case& c, std::size_t pixels, std::uint64_t seed) {
  Events events = law::simulate(c.chip, law::path_of(c.chip, c.light_fa, static_cast<std::size_t>(c.duration_us)),
                                pixels, seed, kGroups, static_cast<std::size_t>(c.shift_us));
  for (auto& of_pixel : events)
    for (law::Fired& e : of_pixel) e.t_us = std::round(e.t_us);
  return events;
}

// One value per pixel, which is independent of the other pixels.
template <class Value>
std::vector<double> by_pixel(const Events& events, Value&& value) {
  std::vector<double> values;
  for (const auto& of_pixel : events) values.push_back(value(of_pixel));
  return values;
}

struct Moments {
  double mean, variance;
};
Moments moments(const std::vector<double>& v) {
  double sum = 0, square = 0;
  for (const double x : v) sum += x, square += x * x;
  const double n = static_cast<double>(v.size()), mean = sum / n;
  return {mean, std::max(0.0, square / n - mean * mean)};
}

double two_sided(double z) { return std::erfc(std::abs(z) / std::numbers::sqrt2); }

// Standard error of the means' difference (Welch).
double normal_score(const std::vector<double>& a, const std::vector<double>& b) {
  const Moments x = moments(a), y = moments(b);
  const double error =
      std::sqrt(x.variance / static_cast<double>(a.size()) + y.variance / static_cast<double>(b.size()));
  return error > 0 ? (x.mean - y.mean) / error : 0;
}

// Kolmogorov and Smirnov: probability of a distance as large between the distributions, at most.
double kolmogorov(std::vector<double> a, std::vector<double> b) {
  std::ranges::sort(a);
  std::ranges::sort(b);
  const auto share = [](const std::vector<double>& v, double x) {
    return static_cast<double>(std::ranges::upper_bound(v, x) - v.begin()) / static_cast<double>(v.size());
  };
  double distance = 0;
  for (const auto* v : {&a, &b})
    for (const double x : *v) distance = std::max(distance, std::abs(share(a, x) - share(b, x)));
  const double n = static_cast<double>(a.size()), m = static_cast<double>(b.size());
  return std::min(1.0, 2 * std::exp(-2 * distance * distance * n * m / (n + m)));
}

// Chi-square per degree of freedom of the events' phases within intervals of `spacing_us`, and its normal score (Wilson
// and Hilferty). Events that follow another one of their pixel within the same length are left out: chains.
struct Phases {
  int count;
  double per_freedom, score;
};
Phases phases_of(const Events& events, double spacing_us, double from_us) {
  const auto spacing = static_cast<std::int64_t>(spacing_us), bins = std::min<std::int64_t>(spacing, 50);
  std::vector<double> counts(static_cast<std::size_t>(bins));
  for (const auto& of_pixel : events)
    for (std::size_t i = 0; i < of_pixel.size(); ++i) {
      const double t = of_pixel[i].t_us;
      if (t <= from_us || (i > 0 && t - of_pixel[i - 1].t_us <= spacing_us)) continue;
      ++counts[static_cast<std::size_t>(static_cast<std::int64_t>(t) % spacing * bins / spacing)];
    }
  const double all = std::accumulate(counts.begin(), counts.end(), 0.0), mean = all / static_cast<double>(bins);
  double sum = 0;
  for (const double n : counts) sum += (n - mean) * (n - mean) / mean;
  const double freedom = static_cast<double>(bins - 1), spread = 2 / (9 * freedom);
  return {static_cast<int>(all), sum / freedom, (std::cbrt(sum / freedom) - 1 + spread) / std::sqrt(spread)};
}

// All comparisons of a test.
class Jury {
 public:
  explicit Jury(std::size_t pixels) : pixels_(pixels * (long_tests() ? 8 : 1)) {}

  void hear(const Case& c) {
    const std::uint64_t seed = 100 * ++cases_;
    const Events expected = of_reference(c, pixels_, seed);
    const auto events_of = [&](const Events& e) { return by_pixel(e, [](const auto& p) { return double(p.size()); }); };
    const std::vector<double> all = events_of(expected);
    const double events = std::accumulate(all.begin(), all.end(), 0.0);
    EXPECT_GT(events, 200) << c.name << ": too few to compare";
    for (const double spacing_us : kSpacings_us) {
      if (spacing_us < c.finest_us || spacing_us > c.coarsest_us) continue;
      const Events found = of_kernel(c, spacing_us, pixels_, seed + 1);
      place_ = c.name + ", planes of " + std::to_string(static_cast<int>(spacing_us)) + " us";
      spacing_us_ = spacing_us;
      compare_rates(found, expected);
      compare_times(found, expected, c.duration_us);
      compare_phases(found, expected);
      if (!c.is_even || (c.name.starts_with("ramp") && spacing_us > 2000)) continue;
      const Phases phases = phases_of(found, spacing_us, std::floor(c.duration_us / 30'000) * 10'000);
      if (phases.count >= 1000)
        add("flat phase (chi-square " + std::to_string(phases.per_freedom) + ")",
            phases.score > 0 ? two_sided(phases.score) / 2 : 1);
    }
  }

  void verdict() {
    // Small errors of one direction: the sum over cases.
    for (const auto& [what, scores] : scores_) {
      place_ = "all cases";
      const double sum = std::accumulate(scores.begin(), scores.end(), 0.0);
      add(what, two_sided(sum / std::sqrt(static_cast<double>(scores.size()))));
    }
    const double limit = kSignificance / static_cast<double>(found_.size());
    std::map<std::string, std::string> guilty;
    for (const auto& [place, what, chance] : found_) {
      if (long_tests()) std::printf("%s, %s: p %.2g\n", place.c_str(), what.c_str(), chance);
      if (chance < limit) guilty[place] += "\n  " + what + ": p " + std::to_string(std::log10(chance + 1e-300));
    }
    for (const auto& [place, what] : guilty) ADD_FAILURE() << place << " (log10 p):" << what;
    testing::Test::RecordProperty("comparisons", static_cast<int>(found_.size()));
  }

 private:
  struct Found {
    std::string place, what;
    double chance;  // of a difference as large, if the law is the same
  };
  void add(const std::string& what, double chance) { found_.push_back({place_, what, chance}); }
  void add_scores(const std::string& what, const std::vector<double>& found, const std::vector<double>& expected) {
    const double score = normal_score(found, expected);
    char text[80];
    std::snprintf(text, sizeof text, " (%.4g, expected %.4g per pixel)", moments(found).mean, moments(expected).mean);
    add(what + text, two_sided(score));
    scores_[what + ", planes of " + std::to_string(static_cast<int>(spacing_us_)) + " us"].push_back(score);
  }
  void compare_rates(const Events& found, const Events& expected) {
    const auto count = [](const Events& events, bool on) {
      return by_pixel(events, [on](const auto& p) {
        return static_cast<double>(std::ranges::count_if(p, [on](const auto& e) { return e.on == on; }));
      });
    };
    const std::vector<double> on = count(found, true), off = count(found, false);
    const std::vector<double> expected_on = count(expected, true), expected_off = count(expected, false);
    add_scores("ON", on, expected_on);
    add_scores("OFF", off, expected_off);
    const double ons = moments(on).mean + moments(expected_on).mean,
                 share = ons / (ons + moments(off).mean + moments(expected_off).mean);
    const auto beyond = [share](const std::vector<double>& a, const std::vector<double>& b) {
      std::vector<double> values;
      for (std::size_t i = 0; i < a.size(); ++i) values.push_back(a[i] - share * (a[i] + b[i]));
      return values;
    };
    add_scores("ON beyond their share", beyond(on, off), beyond(expected_on, expected_off));
  }
  // Delays of the first events, and from there to the second ones: later than the end if there are none.
  void compare_times(const Events& found, const Events& expected, double end_us) {
    const auto first = [=](const auto& p) { return p.empty() ? end_us : p[0].t_us; };
    const auto interval = [=](const auto& p) { return p.size() < 2 ? end_us : p[1].t_us - p[0].t_us; };
    add("first events", kolmogorov(by_pixel(found, first), by_pixel(expected, first)));
    add("intervals", kolmogorov(by_pixel(found, interval), by_pixel(expected, interval)));
  }
  void compare_phases(const Events& found, const Events& expected) {
    for (const bool cosine : {false, true}) {
      const auto wave = [&](const auto& p) {
        double sum = 0;
        for (const auto& e : p) {
          const double phase = 2 * std::numbers::pi * e.t_us / spacing_us_;
          sum += cosine ? std::cos(phase) : std::sin(phase);
        }
        return sum;
      };
      add_scores(cosine ? "cosine of phase" : "sine of phase", by_pixel(found, wave), by_pixel(expected, wave));
    }
  }

  std::size_t pixels_;
  std::uint64_t cases_ = 0;
  std::string place_;
  double spacing_us_ = 0;
  std::vector<Found> found_;
  std::map<std::string, std::vector<double>> scores_;
};

std::string named(const char* waveform, const Chip& chip, double light_fa) {
  char text[80];
  std::snprintf(text, sizeof text, "%s, %s, %g fA", waveform, chip.name.c_str(), light_fa);
  return text;
}

}  // namespace

// In still light, thresholds are so many standard deviations that noise makes events; the chips' own in the long form.
TEST(Law, StillLight) {
  Jury jury(1024);
  for (const auto& [name, lights] : {std::pair{"imx636", std::vector<double>{1, 30, 300, 3e3, 1e5}},
                                     {"davis346", {1, 300, 3e3}},
                                     {"gen3_vga", {30, 3e3, 1e5}},
                                     {"genx320", {300}}})
    for (const double light_fa : lights) {
      Case c{named("still", noisy(name), light_fa), noisy(name), [=](double) { return light_fa; }, 60'000};
      c.is_even = true;
      const double stds = light_fa < 10 ? 0.4 : 3;  // in the dimmest, noise moves slowly
      c.chip.contrast_threshold_on = stds * deviation(c.chip, light_fa);
      c.chip.contrast_threshold_off = 1.1 * stds * deviation(c.chip, light_fa);
      jury.hear(c);
    }
  for (const char* name : {"imx636", "gen3_vga"}) {  // noise and leak of an interval are near a float's resolution
    Chip chip = noisy(name);
    const double dark_fa = chip.dark_current_a * 1e15;
    Case c{named("dark", chip, dark_fa), chip, [=](double) { return dark_fa; }, 60'000};
    c.is_even = true;
    c.chip.contrast_threshold_on = c.chip.contrast_threshold_off = 0.15 * deviation(chip, dark_fa);
    c.chip.leak_rate_hz = 20;
    jury.hear(c);
  }
  if (long_tests())
    for (const char* name : {"imx636", "davis346", "gen3_vga"})
      for (const double light_fa : {30.0, 300.0}) {
        Case c{named("still, own thresholds", noisy(name), light_fa), noisy(name), [=](double) { return light_fa; },
               300'000};
        c.is_even = true;
        jury.hear(c);
      }
  jury.verdict();
}

// Light whose logarithm is linear: every spacing gives the light exactly.
TEST(Law, ExponentialRamp) {
  Jury jury(512);
  int index = 0;
  for (const char* name : {"imx636", "davis346", "gen3_vga", "genx320"})
    for (const double light_fa : {1.0, 30.0, 300.0, 3e3, 1e5}) {
      if (name == std::string("genx320") && light_fa != 300) continue;
      const double per_us = (index++ % 2 == 0 ? 30e-6 : -30e-6) * (light_fa < 10 ? 0.7 : 1), end_us = 80'000;
      const double start = per_us < 0 ? light_fa * 8 : light_fa;
      Case c{named(per_us < 0 ? "ramp down to" : "ramp up from", noisy(name), light_fa), noisy(name),
             [=](double t) { return start * std::exp(per_us * t); }, end_us};
      c.is_even = true;
      jury.hear(c);
    }
  jury.verdict();
}

// A period of 40 ms. Between planes of .5 ms the light is interpolated within 4e-4 of its logarithm.
TEST(Law, Sine) {
  Jury jury(512);
  for (const auto& [name, light_fa] :
       {std::pair{"imx636", 30.0}, {"imx636", 3e3}, {"davis346", 300.0}, {"davis346", 3e3}, {"gen3_vga", 1e5}}) {
    const auto light = [fa = light_fa](double t) {
      return fa * std::exp(0.6 * std::sin(2 * std::numbers::pi * t / 40'000));
    };
    Case c{named("sine", noisy(name), light_fa), noisy(name), light, 80'000};
    c.coarsest_us = 500;
    c.shift_us = 1250;
    jury.hear(c);
  }
  jury.verdict();
}

// A step within 25 us, which has a plane at either end: light before and after is constant, so that all spacings will
// do. One of 60 % up or down.
TEST(Law, Step) {
  Jury jury(1024);
  for (const auto& [name, light_fa, change] : {std::tuple{"imx636", 1.0, 0.9},
                                               {"imx636", 30.0, -0.9},
                                               {"imx636", 3e3, 0.6},
                                               {"davis346", 30.0, 0.6},
                                               {"davis346", 3e3, -0.6},
                                               {"gen3_vga", 300.0, 0.6},
                                               {"gen3_vga", 1e5, -0.6}}) {
    const auto light = [fa = light_fa, by = change](double t) {
      return fa * std::exp(by * std::clamp((t - 3'725) / 25, 0.0, 1.0));
    };
    Case c{named("step", noisy(name), light_fa), noisy(name), light, 30'000};
    c.corners_us = {3'725, 3'750};
    jury.hear(c);
  }
  jury.verdict();
}

// A soft edge that passes one pixel after another, a rise of a factor of 4 within about 4 ms.
TEST(Law, PassingEdge) {
  Jury jury(1024);
  for (const auto& [name, light_fa] :
       {std::pair{"imx636", 30.0}, {"imx636", 300.0}, {"davis346", 300.0}, {"gen3_vga", 3e3}, {"genx320", 1e5}}) {
    const auto light = [fa = light_fa](double t) { return fa * std::exp(0.7 * std::tanh((t - 10'000) / 2'000)); };
    Case c{named("edge", noisy(name), light_fa), noisy(name), light, 30'000};
    c.coarsest_us = 100;
    c.shift_us = 1300;
    jury.hear(c);
  }
  jury.verdict();
}

// The share of pixels that noise makes fire: a reference x drawn from the noise, and levels that are passed as often as
// Rice's formula says. Against it, the reference of this file and the kernel.
TEST(Law, RareEventsFollowRice) {
  Case c{"Rice", noisy("imx636"), [](double) { return 300.0; }, 10'000};
  c.chip.threshold_mismatch = 0;
  const double s = deviation(c.chip, 300), corner_hz = c.chip.corner_hz_per_a * 300e-15, stds = 6;
  c.chip.contrast_threshold_on = c.chip.contrast_threshold_off = stds * s;
  const double passes = std::sqrt(corner_hz * c.chip.amplifier_cutoff_hz) * c.duration_us * 1e-6;
  double expected = 0;
  for (double x = -8; x < 8; x += 0.001) {
    const double often = passes * (std::exp(-0.5 * (stds + x) * (stds + x)) + std::exp(-0.5 * (stds - x) * (stds - x)));
    expected += 0.001 / std::sqrt(2 * std::numbers::pi) * std::exp(-0.5 * x * x) * -std::expm1(-often);
  }
  const auto fires = [](const auto& p) { return p.empty() ? 0.0 : 1.0; };
  const std::size_t pixels = long_tests() ? 1 << 18 : 1 << 15;
  const double error = 3.5 * std::sqrt(expected / static_cast<double>(pixels)) + 0.03 * expected;  // Rice: clumps
  EXPECT_NEAR(moments(by_pixel(of_reference(c, pixels, 7), fires)).mean, expected, error);
  for (const double spacing_us : {10'000.0, 500.0})
    EXPECT_NEAR(moments(by_pixel(of_kernel(c, spacing_us, pixels, 7), fires)).mean, expected, error) << spacing_us;
}

// The reference's own steps: the stationary variances remain, and n of two steps makes that of one twice as long.
TEST(LawReference, StepsKeepTheStationaryNoise) {
  for (const double r : {1e-5, 6e-3, 0.0295, 2.0}) {
    const double b = 0.0292, q = 2 * r, share = b / (b + r);  // variance 1
    for (const double h : {1.0, 40.0}) {
      const law::NoiseStep m = law::noise_step(r, q, b, h);
      const double nn = m.n_n * m.n_n + m.s_n * m.s_n;
      const double nz = m.n_n * (m.z_n + m.z_z * share) + m.s_n * m.s_zn;
      const double zz =
          m.z_n * m.z_n + 2 * m.z_n * m.z_z * share + m.z_z * m.z_z * share + m.s_zn * m.s_zn + m.s_zz * m.s_zz;
      EXPECT_NEAR(nn, 1, 1e-9) << r;
      EXPECT_NEAR(nz, share, 1e-9) << r;
      EXPECT_NEAR(zz, share, 1e-9) << r;
      // z(t) correlates with z(0) by (b e^-rt - r e^-bt) / (b - r).
      const double correlation = (b * std::exp(-r * h) - r * std::exp(-b * h)) / (b - r);
      EXPECT_NEAR(m.z_n + m.z_z, correlation, 1e-9) << r;
    }
  }
}

// Without noise, reference and kernel are equal except for rounding.
TEST(LawReference, WithoutNoiseIsTheKernel) {
  for (const auto& [name, light_fa] : {std::pair{"imx636", 30.0}, {"davis346", 300.0}, {"gen3_vga", 1e4}}) {
    const auto light = [fa = light_fa](double t) { return fa * std::exp(1.1 * std::sin(t / 9'000)); };
    Case c{name, noisy(name), light, 50'000};
    c.chip.noise_std = c.chip.threshold_mismatch = 0;
    c.chip.leak_rate_hz = 5;
    c.shift_us = 700;
    const Events expected = of_reference(c, 64, 1), found = of_kernel(c, 100, 64, 1);
    for (std::size_t p = 0; p < expected.size(); ++p) {
      ASSERT_EQ(found[p].size(), expected[p].size()) << name;
      ASSERT_GT(found[p].size(), 5u);
      for (std::size_t i = 0; i < found[p].size(); ++i) {
        EXPECT_EQ(found[p][i].on, expected[p][i].on);
        EXPECT_NEAR(found[p][i].t_us, expected[p][i].t_us, 15) << name << ' ' << i;
      }
    }
  }
}

// Single precision has no room for the leak of one short interval next to the reference.
TEST(LawReference, TheLeakIsAsFastInShortIntervals) {
  for (const double spacing_us : {10'000.0, 25.0}) {
    const Chip chip = noisy("imx636");
    Case c{"leak", chip, [&](double) { return chip.dark_current_a * 1e15; }, 300'000};
    c.chip.noise_std = c.chip.threshold_mismatch = 0;
    c.chip.contrast_threshold_on = 0.001;
    c.chip.leak_rate_hz = 10;
    for (const auto& of_pixel : of_kernel(c, spacing_us, 16, 1)) {
      ASSERT_EQ(of_pixel.size(), 2u) << spacing_us;
      EXPECT_NEAR(of_pixel[1].t_us, 200'000, 600) << spacing_us;
    }
  }
}

// Fine thresholds tell the noise at every plane, less what it was at the start: D(j), the mean square of its change
// over j planes, is 2 variance (1 - correlation(j)). With rates r of the photoreceptor and b of the amplifier, the
// variance is b / (b + r) and the correlation (b e^-rt - r e^-bt) / (b - r).
TEST(Noise, VarianceAndAutocorrelationAreThoseOfBothPoles) {
  constexpr std::size_t kPixels = 2304, kPlanes = 121;
  constexpr double kThreshold = 0.05, kPlane_us = 1000;  // standard deviations
  for (const auto& [exposure, amplifier] :
       {std::pair{0.05, 0.08}, {0.15, 0.03}, {0.1, 2.0}, {2.0, 0.1}, {0.7, 0.9}, {3.0, 3.1}, {20.0, 1.0}}) {
    Case c{"fine", without_noise(load_chip("imx636")), {}, kPlane_us * (kPlanes - 1)};
    const double a = 2e-21 * std::numbers::pi * c.chip.corner_hz_per_a;
    c.light_fa = [light = exposure / (a * kPlane_us)](double) { return light; };
    c.chip.noise_std = 0.03;
    c.chip.amplifier_cutoff_hz = amplifier / (2e-6 * std::numbers::pi * kPlane_us);
    c.chip.refractory_period_s = c.chip.dark_current_a = 0;
    c.chip.contrast_threshold_on = c.chip.contrast_threshold_off = kThreshold * c.chip.noise_std;
    std::vector<std::vector<double>> v;  // [pixel][plane]
    for (const auto& of_pixel : of_kernel(c, kPlane_us, kPixels, 3)) {
      auto& at = v.emplace_back(kPlanes);
      auto last = at;
      for (const law::Fired& e : of_pixel) {
        const auto plane = static_cast<std::size_t>((e.t_us + kPlane_us - 1) / kPlane_us);
        last[plane] = e.on ? kThreshold : -kThreshold;
        at[plane] += last[plane];
      }
      std::partial_sum(at.begin(), at.end(), at.begin());
      for (std::size_t k = 1; k < kPlanes; ++k) {
        if (last[k] == 0) last[k] = last[k - 1];
        at[k] += last[k] / 2;  // noise has moved on from its last threshold
      }
    }
    for (const std::size_t apart : {1u, 2u, 5u, 20u, 60u}) {
      const std::vector<double> squares = [&] {
        std::vector<double> of_pixels;
        for (const auto& at : v) {
          double sum = 0;
          for (std::size_t k = 0; k + apart < kPlanes; ++k) sum += std::pow(at[k + apart] - at[k], 2);
          of_pixels.push_back(sum / static_cast<double>(kPlanes - apart));
        }
        return of_pixels;
      }();
      const Moments d = moments(squares);
      const double n = exposure * static_cast<double>(apart), z = amplifier * static_cast<double>(apart);
      const double correlation = (amplifier * std::exp(-n) - exposure * std::exp(-z)) / (amplifier - exposure);
      EXPECT_NEAR(d.mean, 2 * amplifier / (amplifier + exposure) * (1 - correlation),
                  3.5 * std::sqrt(d.variance / kPixels) + 2 * kThreshold * kThreshold)
          << exposure << " " << amplifier << " " << apart;
    }
  }
}

TEST(Noise, NeighboursAreIndependent) {
  constexpr std::size_t kWidth = 192, kPixels = kWidth * 16 * 8;
  Case c{"neighbours", noisy("imx636"), [](double) { return 300.0; }, 20'000};
  c.chip.contrast_threshold_on = c.chip.contrast_threshold_off = 2.5 * deviation(c.chip, 300);
  c.chip.threshold_mismatch = 0;
  const auto counts = by_pixel(of_kernel(c, 500, kPixels, 3), [](const auto& p) { return double(p.size()); });
  const auto [mean, variance] = moments(counts);
  EXPECT_GT(mean, 1);
  for (const std::size_t apart : {std::size_t{1}, std::size_t{2}, kPixels / 16, std::size_t{1024}}) {
    double sum = 0;
    for (std::size_t i = 0; i + apart < kPixels; ++i) sum += (counts[i] - mean) * (counts[i + apart] - mean);
    EXPECT_NEAR(sum / (variance * kPixels), 0, 4 / std::sqrt(static_cast<double>(kPixels))) << apart;
  }
}

}  // namespace pecs::sensor
