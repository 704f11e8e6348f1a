#include "pecs/metrics/realism.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "pecs/metrics/compare.h"

namespace pecs::metrics {
namespace {

using events::Event;
using events::Stream;

struct Camera {
  unsigned seed = 1;
  double mismatch = 0.5, hot = 0, noise_hz = 1, rate = 1;
  std::int64_t clock_us = 1, end_us = 200'000;
  int width = 192, height = 160;
};

// Bars that move by a pixel per ms; a pixel may fire within 3 ms of an edge.
Stream recording(const Camera& c) {
  std::mt19937_64 random(c.seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> part;
  Stream s{{c.width, c.height, ""}, {}};
  for (int y = 0; y < c.height; ++y)
    for (int x = 0; x < c.width; ++x) {
      const double sensitivity = std::exp(c.mismatch * normal(random)) * c.rate * 0.2;
      const double still = (c.noise_hz + (part(random) < c.hot ? 500 : 0)) * 1e-3;
      for (std::int64_t ms = 0; ms < c.end_us / 1000; ++ms) {
        const int behind = static_cast<int>((ms + 1000 - x - y / 3) % 24);
        if (part(random) > still + (behind % 12 < 3 ? sensitivity : 0)) continue;
        const std::int64_t t = 1000 * ms + static_cast<std::int64_t>(1000 * part(random));
        s.events.push_back(
            {t / c.clock_us * c.clock_us, static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), behind < 12});
      }
    }
  std::stable_sort(s.events.begin(), s.events.end(), [](auto& a, auto& b) { return a.t_us < b.t_us; });
  return s;
}

std::string first_named(const Camera& real, const Camera& sim) {
  const auto r = realism(recording(real), recording(sim), 1);
  if (!r) return "no realism";
  return r->named.empty() ? "none" : r->named[0];
}

TEST(Realism, TwoCamerasOfOneKindAreNotToldApart) {
  const auto r = realism(recording({}), recording({.seed = 2}), 1);
  ASSERT_TRUE(r);
  EXPECT_LT(r->all.interval.low, 0.5);
  EXPECT_GT(r->all.interval.high, 0.5);
  EXPECT_TRUE(r->named.empty()) << r->named[0];
  ASSERT_TRUE(r->floor);
  EXPECT_LT(r->floor->interval.low, 0.5);
  EXPECT_GT(r->floor->interval.high, 0.5);
}

TEST(Realism, PlantedErrorsAreNamed) {
  EXPECT_EQ(first_named({}, {.seed = 2, .clock_us = 1000}), "clock");
  EXPECT_EQ(first_named({.hot = 0.004}, {.seed = 2}), "hot pixels");
  EXPECT_EQ(first_named({}, {.seed = 2, .mismatch = 0}), "pixels");
}

TEST(Realism, OriginOrderAndLengthDoNotCount) {
  const Stream real = recording({});
  Stream sim = recording({.seed = 2, .clock_us = 100}), other = sim;
  const auto whole = to_json(*realism(real, sim, 1));
  for (std::size_t i = 1; i < other.events.size(); ++i)  // equal times in another order
    if (other.events[i].t_us == other.events[i - 1].t_us) std::swap(other.events[i], other.events[i - 1]), ++i;
  for (Event& e : other.events) e.t_us += 1'234'567;
  CompareOptions options{.split_half = false, .realism = true};
  EXPECT_EQ(to_json(compare(real, "real", other, "sim", options)).at("realism"), whole);
  // What is after the end of the shorter one does not count, nor does the size.
  other = recording({.seed = 3, .end_us = 300'000, .width = 256, .height = 128});
  options.normalisation = Normalisation::eq16;
  const auto c = compare(real, "real", other, "sim", options);
  ASSERT_TRUE(c.realism);
  EXPECT_TRUE(c.realism->named.empty());
}

TEST(Realism, ThreeTimesTheRateIsACueOfItsOwn) {
  const auto r = realism(recording({.rate = 0.4}), recording({.seed = 2, .rate = 1.2}), 1);
  ASSERT_TRUE(r);
  EXPECT_GT(r->cues[0].auc.value, 0.9);
  EXPECT_EQ(r->cues[0].name, "rate");
  EXPECT_FALSE(r->matched);
  EXPECT_NE(sentences(*r).back().find("change it first"), std::string::npos);
}

TEST(Realism, TooFewPatchesAreAWarning) {
  const Stream small = recording({.width = 64, .height = 48});
  const auto c = compare(small, "real.raw", small, "sim.raw", {.realism = true});
  EXPECT_FALSE(c.realism);
  ASSERT_EQ(c.warnings.size(), 1U);
  EXPECT_NE(c.warnings[0].find("no realism"), std::string::npos);
  EXPECT_TRUE(to_json(c).at("realism").is_null());
}

}  // namespace
}  // namespace pecs::metrics
