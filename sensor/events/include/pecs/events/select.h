#pragma once
// Selects a part of a stream, block by block.
#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <vector>

#include "pecs/events/format.h"

namespace pecs::events {

struct Selection {
  std::optional<std::int64_t> t_start_us, t_end_us;  // t_start <= t < t_end, in the input's time
  bool rezero = false;                               // subtract the time of the first event kept
  // Keep the pixels with x % n == n / 2 and y % n == n / 2 and divide their coordinates by n: a camera with the same
  // pixels on a grid n times as wide.
  int decimate = 1;
};

class Selector {
 public:
  explicit Selector(const Selection& selection) : s_(selection) {  // throws usage for an empty selection
    if (s_.t_start_us && s_.t_end_us && *s_.t_start_us >= *s_.t_end_us)
      throw Error(ExitCode::usage,
                  fmt::format("--t-end: got {} us, wanted later than --t-start, {} us", *s_.t_end_us, *s_.t_start_us));
  }

  StreamInfo info(const StreamInfo& info) const {  // throws usage if no pixel is left
    const auto kept = [&](int pixels) { return (pixels - s_.decimate / 2 + s_.decimate - 1) / s_.decimate; };
    if (info.width == 0) return info;
    const StreamInfo out{kept(info.width), kept(info.height), info.camera};
    if (out.width == 0 || out.height == 0)
      throw Error(ExitCode::usage, fmt::format("--decimate: got {}, wanted at most {} for {}x{} pixels", s_.decimate,
                                               2 * std::min(info.width, info.height) - 1, info.width, info.height));
    return out;
  }

  bool keeps(const Event& e) const {
    const int n = s_.decimate, middle = n / 2;
    return !(s_.t_start_us && e.t_us < *s_.t_start_us) && !(s_.t_end_us && e.t_us >= *s_.t_end_us) &&
           e.x % n == middle && e.y % n == middle;
  }

  void apply(std::vector<Event>& events) {
    std::erase_if(events, [&](const Event& e) { return !keeps(e); });
    if (s_.rezero && !zero_us_ && !events.empty()) zero_us_ = events.front().t_us;
    for (Event& e : events) e = written(e);
  }
  // An event that is kept, as it is written; with `rezero`, the first one sets the time.
  Event written(Event e) const {
    e.x = static_cast<std::uint16_t>(e.x / s_.decimate);
    e.y = static_cast<std::uint16_t>(e.y / s_.decimate);
    e.t_us -= zero_us_.value_or(0);
    return e;
  }
  bool has_zero() const { return !s_.rezero || zero_us_; }

 private:
  Selection s_;
  std::optional<std::int64_t> zero_us_;
};

}  // namespace pecs::events
