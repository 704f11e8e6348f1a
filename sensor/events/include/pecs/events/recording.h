#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "pecs/events/format.h"

namespace pecs::events {

// The events of a file, times counted from the first one.
struct Recording {
  std::string name;           // of the file, without folders
  int width = 0, height = 0;  // pixels
  std::int64_t first_us = 0;  // time of the first event in the file
  std::int64_t span_us = 0;   // from the first event to just after the last one
  std::vector<Event> events;  // in time order
  std::int64_t from_us = 0;   // the first of these events, from the first event of the file
};
// Keeps events of [from_us, to_us), relative to the first event. Throws bad_input if none are left. `file` is for
// errors and, without folders, for `name`.
Recording recording_of(Stream stream, const std::string& file, std::int64_t from_us, std::int64_t to_us);

// Those of events in time order that lie in [from_us, to_us).
std::span<const Event> between(std::span<const Event> events, double from_us, double to_us);

}  // namespace pecs::events
