#include "pecs/events/recording.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "pecs/error.h"

namespace pecs::events {

std::span<const Event> between(std::span<const Event> events, double from_us, double to_us) {
  const auto earlier = [](const Event& e, double t_us) { return static_cast<double>(e.t_us) < t_us; };
  const auto first = std::lower_bound(events.begin(), events.end(), from_us, earlier);
  return {first, std::lower_bound(first, events.end(), to_us, earlier)};
}

Recording recording_of(Stream stream, const std::string& file, std::int64_t from_us, std::int64_t to_us) {
  auto& events = stream.events;
  if (events.empty()) throw bad_input(file, "", "0 events", "at least 1");
  if (!std::ranges::is_sorted(events, {}, &Event::t_us)) std::ranges::stable_sort(events, {}, &Event::t_us);

  Recording recording{std::filesystem::path(file).filename().string(),
                      stream.info.width,
                      stream.info.height,
                      events.front().t_us,
                      0,
                      {},
                      0};
  for (Event& e : events) e.t_us -= recording.first_us;
  if (from_us > 0 || to_us <= events.back().t_us) {
    const auto kept = between(events, static_cast<double>(from_us), static_cast<double>(to_us));
    if (kept.empty())
      throw bad_input(file, "time", fmt::format("0 events from {} us to {} us", from_us, to_us),
                      fmt::format("times between 0 and {} us after the first event", events.back().t_us));
    events = {kept.begin(), kept.end()};
    recording.from_us = events.front().t_us;
    recording.first_us += recording.from_us;
    for (Event& e : events) e.t_us -= recording.from_us;
  }
  recording.span_us = events.back().t_us + 1;
  recording.events = std::move(events);
  return recording;
}

}  // namespace pecs::events
