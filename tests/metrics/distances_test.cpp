#include "pecs/metrics/distances.h"

#include <gtest/gtest.h>

#include <cmath>

#include "pecs/error.h"
#include "random_events.h"

namespace pecs::metrics {
namespace {

using events::Event;
using tests::random_events;

constexpr auto kAll = {Normalisation::shared, Normalisation::eq16, Normalisation::paper};

MetricOptions options_for(Normalisation normalisation) {
  return {.normalisation = normalisation, .width = 64, .height = 48, .window_us = 10'000};
}

// Direct implementation of Eq. 12-16 over all pairs, with numpy's integer columns.
struct Plain {
  std::vector<std::array<double, 4>> points;
  Plain(const std::vector<Event>& events, const MetricOptions& o) {
    std::array<double, 4> low, high;
    low.fill(1e300), high.fill(-1e300);
    const auto columns = [](const Event& e) {
      return std::array<double, 4>{double(e.x), double(e.y), double(e.p), double(e.t_us)};
    };
    for (const auto& e : events)
      for (int k = 0; k < 4; ++k) low[k] = std::min(low[k], columns(e)[k]), high[k] = std::max(high[k], columns(e)[k]);
    if (o.normalisation == Normalisation::shared)
      low.fill(0), high = {o.width - 1.0, o.height - 1.0, 1.0, double(o.window_us)};
    const std::array<double, 4> units = {100, 100, 100, 1000};
    for (const auto& e : events) {
      auto& q = points.emplace_back();
      for (int k = 0; k < 4; ++k) {
        const double product = (columns(e)[k] - low[k]) * units[k];
        const double wrapped = k < 2 ? std::fmod(product, 65536) : product;
        q[k] = o.normalisation == Normalisation::paper ? std::trunc(wrapped / (high[k] - low[k] + 1e-6))
                                                       : product / (high[k] - low[k] + 1e-6);
      }
    }
  }
};

Distances brute_force(const std::vector<Event>& a, const std::vector<Event>& b, const MetricOptions& o) {
  const Plain clouds[2] = {Plain(a, o), Plain(b, o)};
  Distances d;
  for (int way = 0; way < 2; ++way) {
    for (const auto& p : clouds[way].points) {
      double best = 1e300;
      for (const auto& q : clouds[1 - way].points) {
        double d2 = 0;
        for (int k = 0; k < 4; ++k) d2 += (p[k] - q[k]) * (p[k] - q[k]);
        best = std::min(best, d2);
      }
      d.chamfer_parts[way] += std::sqrt(best) / static_cast<double>(clouds[way].points.size());
      d.gaussian_parts[way] += (1 - std::exp(-best / o.sigma)) / static_cast<double>(clouds[way].points.size());
    }
  }
  return d;
}

void expect_near(const Distances& got, const Distances& wanted) {
  for (int way = 0; way < 2; ++way) {
    EXPECT_NEAR(got.chamfer_parts[way], wanted.chamfer_parts[way], 1e-4 * (1e-3 + wanted.chamfer_parts[way]));
    EXPECT_NEAR(got.gaussian_parts[way], wanted.gaussian_parts[way], 1e-5);
  }
}

TEST(Metrics, TinyExampleOfThePaper) {
  const std::vector<Event> r = {{0, 0, 0, 0}, {1000, 10, 10, 1}, {2000, 20, 20, 1}};
  std::vector<Event> q = r;
  q[1].t_us = 1001;
  const Distances eq16 = distances(r, q, options_for(Normalisation::eq16));
  EXPECT_NEAR(eq16.chamfer(), 1.0 / 3, 1e-5);
  EXPECT_NEAR(eq16.gaussian(), 2.0 / 3 * (1 - std::exp(-0.25 / 0.4)), 1e-5);
  const Distances paper = distances(r, q, options_for(Normalisation::paper));
  EXPECT_NEAR(paper.chamfer(), 2.0 / 3, 1e-9);
  EXPECT_NEAR(paper.gaussian(), 2.0 / 3 * (1 - std::exp(-1 / 0.4)), 1e-9);
}

TEST(Metrics, TreeEqualsBruteForce) {
  for (const auto normalisation : kAll)
    for (unsigned seed = 0; seed < 6; ++seed) {
      SCOPED_TRACE(testing::Message() << name_of(normalisation) << " seed " << seed);
      const auto a = random_events(200 + 150 * seed, seed), b = random_events(500, 100 + seed, 64, 48, 10'000, 0.2);
      expect_near(distances(a, b, options_for(normalisation)), brute_force(a, b, options_for(normalisation)));
    }
}

TEST(Metrics, TreeEqualsBruteForceOnAWideSensorWhereTheAuthorsProductOverflows) {
  const auto a = random_events(700, 1, 1280, 720), b = random_events(600, 2, 1280, 720);
  for (const auto normalisation : kAll) {
    MetricOptions o = options_for(normalisation);
    o.width = 1280, o.height = 720;
    expect_near(distances(a, b, o), brute_force(a, b, o));
  }
}

TEST(Metrics, OneSidedStreamsAndManyTies) {
  auto a = random_events(400, 1, 8, 8, 50, 1.0), b = random_events(400, 2, 8, 8, 50, 0.0);
  const auto both = random_events(400, 3, 8, 8, 50);
  std::vector<Event> same(300, Event{5, 3, 3, 1});
  for (const auto normalisation : kAll) {
    const auto o = options_for(normalisation);
    for (const auto& [first, second] : {std::pair{a, b}, {a, both}, {both, b}, {a, a}, {same, both}, {same, same}})
      expect_near(distances(first, second, o), brute_force(first, second, o));
  }
}

TEST(Metrics, ZeroToItselfAndSymmetric) {
  for (const auto normalisation : kAll) {
    const auto a = random_events(3000, 7), b = random_events(2000, 8);
    const auto o = options_for(normalisation);
    EXPECT_EQ(distances(a, a, o).chamfer(), 0);
    EXPECT_EQ(distances(a, a, o).gaussian(), 0);
    const Distances ab = distances(a, b, o), ba = distances(b, a, o);
    EXPECT_EQ(ab.chamfer_parts[0], ba.chamfer_parts[1]);
    EXPECT_EQ(ab.gaussian_parts[1], ba.gaussian_parts[0]);
  }
}

TEST(Metrics, OrderOfEventsDoesNotMatter) {
  auto a = random_events(2000, 7);
  const auto b = random_events(2000, 8);
  const auto before = distances(a, b, options_for(Normalisation::shared));
  std::reverse(a.begin(), a.end());
  const auto after = distances(a, b, options_for(Normalisation::shared));
  EXPECT_NEAR(before.chamfer(), after.chamfer(), 1e-9);
}

TEST(Metrics, SharedNormalisationDetectsAShiftThatEq16Hides) {
  const auto a = random_events(2000, 7, 64, 48, 10'000);
  auto shifted = a;
  for (auto& e : shifted) e.t_us += 2000, e.x = static_cast<std::uint16_t>(e.x + 3);
  MetricOptions o = options_for(Normalisation::eq16);
  EXPECT_LT(distances(a, shifted, o).chamfer(), 1e-3);
  o = options_for(Normalisation::shared);
  EXPECT_GT(distances(a, shifted, o).chamfer(), 10);
}

TEST(Metrics, EmptyStreamsAreErrors) {
  const auto a = random_events(10, 1);
  EXPECT_THROW(distances(a, {}, options_for(Normalisation::shared)), Error);
  EXPECT_THROW(distances({}, a, options_for(Normalisation::eq16)), Error);
  EXPECT_THROW(distances(a, a, MetricOptions{}), Error);
  EXPECT_THROW(normalisation_from("float"), Error);
}

}  // namespace
}  // namespace pecs::metrics
