#pragma once
// Random streams for property tests.
#include <algorithm>
#include <random>
#include <vector>

#include "pecs/events/event.h"

namespace pecs::tests {

inline std::vector<events::Event> random_events(std::size_t count, unsigned seed, int width = 64, int height = 48,
                                                std::int64_t span_us = 10'000, double on_fraction = 0.5) {
  std::mt19937 random(seed);
  std::uniform_int_distribution<int> x(0, width - 1), y(0, height - 1);
  std::uniform_int_distribution<std::int64_t> t(0, span_us - 1);
  std::bernoulli_distribution on(on_fraction);
  std::vector<events::Event> events(count);
  for (auto& e : events)
    e = {t(random), static_cast<std::uint16_t>(x(random)), static_cast<std::uint16_t>(y(random)), on(random)};
  std::sort(events.begin(), events.end(), [](const auto& a, const auto& b) { return a.t_us < b.t_us; });
  return events;
}

}  // namespace pecs::tests
