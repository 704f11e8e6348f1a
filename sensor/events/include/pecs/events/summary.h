#pragma once
// Statistics of a stream for `pecs info`, gathered block by block.
#include <algorithm>
#include <limits>
#include <optional>
#include <span>

#include "pecs/events/event.h"
#include "pecs/strict_json.h"

namespace pecs::events {

struct Summary {
  std::uint64_t events = 0, on = 0;
  std::uint64_t time_reversals = 0;                                   // events earlier than the one before
  std::int64_t before_us = std::numeric_limits<std::int64_t>::min();  // time of the last event
  std::optional<std::int64_t> t_first_us, t_last_us;                  // the least and the greatest

  void add(std::span<const Event> block) {
    for (const Event& e : block) {
      time_reversals += e.t_us < before_us;
      before_us = e.t_us;
      t_first_us = std::min(t_first_us.value_or(e.t_us), e.t_us);
      t_last_us = std::max(t_last_us.value_or(e.t_us), e.t_us);
      on += e.p;
    }
    events += block.size();
  }

  // "events", "t_first_us", "t_last_us", "duration_us", "on_fraction", "time_reversals", "event_rate_hz",
  // "event_rate_per_pixel_hz"; null if the stream has no events, duration or size.
  Json json(int width, int height) const {
    Json out = {{"events", events}, {"time_reversals", time_reversals}};
    for (const char* key :
         {"t_first_us", "t_last_us", "duration_us", "on_fraction", "event_rate_hz", "event_rate_per_pixel_hz"})
      out[key] = nullptr;
    if (events == 0) return out;
    const std::int64_t duration_us = *t_last_us - *t_first_us;
    out["t_first_us"] = *t_first_us;
    out["t_last_us"] = *t_last_us;
    out["duration_us"] = duration_us;
    out["on_fraction"] = static_cast<double>(on) / static_cast<double>(events);
    if (duration_us <= 0) return out;
    const double rate_hz = static_cast<double>(events) / (static_cast<double>(duration_us) * 1e-6);
    out["event_rate_hz"] = rate_hz;
    if (width > 0 && height > 0)
      out["event_rate_per_pixel_hz"] = rate_hz / (static_cast<double>(width) * static_cast<double>(height));
    return out;
  }
};

}  // namespace pecs::events
