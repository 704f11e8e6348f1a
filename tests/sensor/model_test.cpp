// One suite over every pixel model, and each of the other simulators' models against its formula.
#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "clip.h"
#include "pecs/error.h"
#include "pecs/sensor/pixel_model.h"

namespace pecs::sensor {
namespace {

using events::Event;

std::vector<Event> run(const ModelChoice& model, const Chip& chip, const Clip& clip, std::uint64_t seed = 1,
                       std::size_t batch = 1000, int threads = 2) {
  Sensor sensor(chip, clip.width, clip.height, seed, 100.0, model);
  return run_clip(sensor, clip, batch, threads);
}

double bars(int x, int y, double t_us) { return 0.5 + 0.45 * std::sin(0.3 * x + 0.05 * y - t_us * 2e-3); }

// Noise that comes from the model's own parameters, not from the chip, as near to 0 as it can be.
ModelChoice without_own_noise(const std::string& name) {
  ModelChoice model{name, {}, 0};
  for (const ModelParameter& p : model_parameters(name))
    if (p.is_noise) model.parameters[p.key] = std::clamp(0.0, p.min, p.max);
  return model;
}

class EveryModel : public testing::TestWithParam<std::string> {};

TEST_P(EveryModel, ThreadsAndBatchesChangeNothingButTheSeedDoes) {
  const Clip clip = make_clip(101, 97, 41, 333.3, bars);
  const Chip chip = load_chip("imx636", {"background_on_hz=20", "background_off_hz=20"});
  const ModelChoice model{GetParam(), {}, 0};
  const auto events = run(model, chip, clip);
  ASSERT_GT(events.size(), 10000u);
  for (std::size_t i = 1; i < events.size(); ++i) ASSERT_GE(events[i].t_us, events[i - 1].t_us);
  for (const Event& e : events) ASSERT_TRUE(e.x < 101 && e.y < 97);
  EXPECT_EQ(events, run(model, chip, clip, 1, 1000, 1));
  EXPECT_EQ(events, run(model, chip, clip, 1, 7, 7));
  EXPECT_EQ(events, run(model, chip, clip, 1, 1, 2));
  EXPECT_EQ(events != run(model, chip, clip, 2), model_traits({GetParam()}).is_random);
}

TEST_P(EveryModel, AStillSceneWithoutNoiseGivesNothing) {
  const Clip still = make_clip(97, 31, 50, 333, [](int x, int y, double) { return 1e-3 * (1 + (x * y) % 999); });
  EXPECT_TRUE(run(without_own_noise(GetParam()), load_chip("ideal"), still).empty());
}

TEST_P(EveryModel, ValuesThatAreNoLightChangeNothing) {
  Clip clip = make_clip(10, 2, 9, 1000, [](int, int, double) { return 0.5; });
  clip.frames[3][4] = std::numeric_limits<float>::quiet_NaN();
  clip.frames[4][5] = std::numeric_limits<float>::infinity();
  EXPECT_TRUE(run(without_own_noise(GetParam()), load_chip("ideal"), clip).empty());
}

TEST_P(EveryModel, HoweverBrightTheLightItEnds) {
  const Clip clip = make_clip(4, 2, 6, 1000, [](int x, int y, double t) {
    return (x + y) % 2 ? 1 : t > 2000 ? 1e36 : 0;
  });
  EXPECT_LT(run({GetParam(), {}, 0}, load_chip("imx636"), clip).size(), 20000u);
}

TEST_P(EveryModel, RefusesWrongParametersByName) {
  const Chip chip = load_chip("ideal");
  EXPECT_THROW(open_model({GetParam(), {{"nope", 1}}, 0}, chip, 4, 4, 1, 1), Error);
  EXPECT_THROW(open_model({"nope", {}, 0}, chip, 4, 4, 1, 1), Error);
  for (const ModelParameter& p : model_parameters(GetParam())) {
    EXPECT_TRUE(p.value >= p.min && p.value <= p.max) << p.key;
    EXPECT_THROW(open_model({GetParam(), {{p.key, p.max * 2 + 1}}, 0}, chip, 4, 4, 1, 1), Error) << p.key;
  }
}

INSTANTIATE_TEST_SUITE_P(All, EveryModel, testing::ValuesIn(model_names()),
                         [](const auto& model) { return model.param; });

}  // namespace

TEST(Esim, CrossesWhereTheLogarithmRunsStraight) {
  const Clip clip = make_clip(1, 1, 2, 1000, [](int, int, double t) { return t > 0 ? 1.0 : 0.1; });
  const auto events = run({"esim", {}, 0}, load_chip("ideal"), clip);
  const double l0 = std::log(0.1 + 1e-3), l1 = std::log(1 + 1e-3);
  ASSERT_EQ(events.size(), 11u);  // 2.29 / .2
  for (std::size_t i = 0; i < events.size(); ++i)
    EXPECT_NEAR(static_cast<double>(events[i].t_us), 0.2 * static_cast<double>(i + 1) / (l1 - l0) * 1000, 0.51);
}

TEST(V2e, EventsLieOnTheGridOfTheBusiestPixel) {
  // One pixel rises by 5 thresholds, the other by 2: they share the first times of a grid of 5.
  const Clip clip =
      make_clip(2, 1, 2, 1000, [](int x, int, double t) { return (t > 0 ? std::exp(x == 0 ? 1.1 : 0.5) : 1.0) / 3.5; });
  const auto events = run({"v2e", {}, 0}, load_chip("ideal"), clip);
  std::vector<std::int64_t> first, second;
  for (const Event& e : events) (e.x == 0 ? first : second).push_back(e.t_us);
  EXPECT_EQ(first, (std::vector<std::int64_t>{200, 400, 600, 800, 1000}));
  EXPECT_EQ(second, (std::vector<std::int64_t>{200, 400}));
}

TEST(Icns, AStepIsAnExponentialApproach) {
  const double lux0 = 1000, lux1 = 5000, tau_us = 40 * 1e3 / (lux1 + 1), th = 0.2;
  const Clip clip = make_clip(1, 1, 2, 1000, [&](int, int, double t) { return (t > 0 ? lux1 : lux0) / 1e4; });
  const auto events = run({"icns", {{"jitter_us", 0}, {"latency_us", 100}}, 0}, load_chip("ideal"), clip);
  ASSERT_GE(events.size(), 1u);
  const double swing = std::log((lux1 + 1) / (lux0 + 1));
  EXPECT_NEAR(static_cast<double>(events[0].t_us), 100 - tau_us * std::log(1 - th / swing), 1.0);
}

TEST(Voltmeter, CountsFollowTheDrift) {
  // Without noise a relative change of light of 2 (b - a) / (a + b + 2 k2) moves the voltage by k1 times as much.
  const double a = 50, b = 150, moved = 5.265 * (b - a) / ((a + b) / 2 + 20);
  const Clip clip = make_clip(30, 30, 2, 1000, [&](int, int, double t) { return (t > 0 ? b : a) / 255; });
  const ModelChoice model{"voltmeter", {{"k3", 0}, {"k4", 0}, {"k5", 0}, {"k6", 1e-9}}, 0};
  const auto events = run(model, load_chip("ideal"), clip);
  ASSERT_EQ(events.size(), 900 * static_cast<std::size_t>(moved));
  EXPECT_NEAR(static_cast<double>(events[0].t_us), 1000 / moved, 1);
}

TEST(Voltmeter, NoiseAloneFiresByTheLevyLaw) {
  // Algorithm 1: a side at random, then the first passage of that one threshold: P(t < T) = erfc(1 / (sigma sqrt(2
  // T))).
  const double sigma = 0.02;  // 1/us^.5
  const Clip still = make_clip(200, 200, 2, 1000, [](int, int, double) { return 0.5; });
  const auto events =
      run({"voltmeter", {{"k3", 0}, {"k4", 0}, {"k5", 0}, {"k6", sigma}}, 0}, load_chip("ideal"), still);
  std::set<int> fired;
  double on = 0;
  for (const Event& e : events) {
    fired.insert(e.y * 200 + e.x);
    on += e.p;
  }
  const double expected = std::erfc(1 / (sigma * std::sqrt(2 * 1000.0))), n = static_cast<double>(events.size());
  EXPECT_NEAR(static_cast<double>(fired.size()) / 40000, expected, 4 * std::sqrt(expected / 40000));
  EXPECT_NEAR(on / n, 0.5, 4 * 0.5 / std::sqrt(n));
}

}  // namespace pecs::sensor
