#include "pecs/events/recording.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "pecs/error.h"

namespace pecs::events {
namespace {
bool earlier(const Event& a, const Event& b) { return a.t_us < b.t_us; }
}  // namespace

Recording recording_of(Stream stream, const std::string& file, std::int64_t from_us, std::int64_t to_us) {
  auto& events = stream.events;
  if (events.empty()) throw bad_input(file, "", "0 events", "at least 1");
  if (!std::is_sorted(events.begin(), events.end(), earlier)) std::stable_sort(events.begin(), events.end(), earlier);

  Recording recording{std::filesystem::path(file).filename().string(),
                      stream.info.width,
                      stream.info.height,
                      events.front().t_us,
                      0,
                      {}};
  for (Event& e : events) e.t_us -= recording.first_us;
  if (from_us > 0 || to_us <= events.back().t_us) {
    const auto first = std::lower_bound(events.begin(), events.end(), Event{from_us}, earlier);
    const auto last = std::lower_bound(first, events.end(), Event{to_us}, earlier);
    if (first == last)
      throw bad_input(file, "time", fmt::format("0 events from {} us to {} us", from_us, to_us),
                      fmt::format("times between 0 and {} us after the first event", events.back().t_us));
    events.erase(last, events.end());
    events.erase(events.begin(), first);
    recording.first_us += events.front().t_us;
    const std::int64_t shift = events.front().t_us;
    for (Event& e : events) e.t_us -= shift;
  }
  recording.span_us = events.back().t_us + 1;
  recording.events = std::move(events);
  return recording;
}

}  // namespace pecs::events
