#pragma once
// The event, and its conventions (docs/reference/event_file.md):
//   t_us  integer microseconds since the start of the stream, non-decreasing along it
//   x     right, y down; pixel (0, 0) is top left and its centre lies at (0.5, 0.5)
//   p     1 = brighter (ON), 0 = darker (OFF)
#include <cstdint>

namespace pecs::events {

struct Event {
  std::int64_t t_us = 0;
  std::uint16_t x = 0;
  std::uint16_t y = 0;
  std::uint8_t p = 0;

  friend bool operator==(const Event&, const Event&) = default;
};
static_assert(sizeof(Event) == 16);

}  // namespace pecs::events
