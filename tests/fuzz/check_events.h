#pragma once
#include <span>

#include "fuzz.h"
#include "pecs/events/event.h"

namespace pecs::fuzz {

// What holds of a sensor's events, whatever its light was.
inline void check(std::span<const events::Event> events, int width, int height) {
  for (std::size_t i = 0; i < events.size(); ++i) {
    const events::Event& e = events[i];
    if (e.x >= width || e.y >= height || e.p > 1) defect("an event that no pixel gave");
    if (i > 0 && e.t_us < events[i - 1].t_us) defect("events that are not sorted");
  }
}

}  // namespace pecs::fuzz
