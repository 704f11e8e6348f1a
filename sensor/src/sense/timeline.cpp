#include "pecs/sensor/timeline.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "pecs/error.h"
#include "pecs/sensor/event_slots.h"

namespace pecs::sensor {
Timeline::Timeline(FrameSource& source, const Window& window) : source_(source) {
  const StackInfo& info = source.info();
  if (window.warmup_us > 0 && info.period_ns)
    throw bad_input(source.name(), "--warmup", fmt::format("{} us", window.warmup_us),
                    "--warmup-loops for a periodic stack");
  warmup_us_ = read_out_from_us_ = window.warmup_us;
  from_us_ = window.start_us + warmup_us_;
  to_us_ = std::numeric_limits<std::int64_t>::max();
  if (window.warmup_loops > 0 && !info.period_ns)
    throw bad_input(source.name(), "period_ns", "nothing", "a period, for --warmup-loops");
  const bool is_complete = source.frames() == std::ssize(info.times_ns);
  if (info.period_ns && (window.warmup_loops > 0 || window.duration_us || is_complete)) {
    period_us_ = static_cast<double>(*info.period_ns) * 1e-3;
    const double origin_us = window.warmup_loops * period_us_ + static_cast<double>(window.start_us);
    const double duration_us = window.duration_us ? static_cast<double>(*window.duration_us) : period_us_;
    if (origin_us + duration_us > kMostTime_us)
      throw bad_input(source.name(), "loops", fmt::format("{:.0f} us", origin_us + duration_us),
                      fmt::format("at most {} us", kMostTime_us));
    read_out_from_us_ = std::llround(window.warmup_loops * period_us_);
    from_us_ = std::llround(origin_us);
    to_us_ = from_us_ + std::llround(duration_us);
    // The last interval of the window needs two frames more.
    steps_ = static_cast<std::int64_t>(std::ceil((origin_us + duration_us) / period_us_)) * source.frames() + 2;
    return;
  }
  if (window.duration_us) to_us_ = from_us_ + std::min(*window.duration_us, to_us_ - from_us_);
  while (steps_ < source.frames() && t_us(steps_) < static_cast<double>(to_us_)) ++steps_;
  steps_ = std::min(source.frames(), steps_ + 2);
  const double end_us = t_us(source.frames() - 1);
  if (static_cast<double>(from_us_) > end_us)
    throw bad_input(source.name(), "--start", fmt::format("{} us", window.start_us),
                    fmt::format("at most {} us", end_us - static_cast<double>(warmup_us_)));
  if (window.duration_us && static_cast<double>(to_us_) > end_us)
    warnings_.push_back(fmt::format("{}: --duration: got {}, the last frame is {} us after the window's start",
                                    source.name(), *window.duration_us, end_us - static_cast<double>(from_us_)));
}

double Timeline::t_us(std::int64_t step) const {
  const auto& times_ns = source_.info().times_ns;
  const std::int64_t frames = source_.frames(), rounds = step / frames;
  return static_cast<double>(warmup_us_) + static_cast<double>(rounds) * period_us_ +
         static_cast<double>(times_ns[static_cast<std::size_t>(step % frames)] - times_ns[0]) * 1e-3;
}

std::vector<Region> Timeline::regions(bool pixels_are_independent) const {
  const StackInfo& info = source_.info();
  int rows = info.height;
  if (loops() && pixels_are_independent) {
    const std::size_t row_bytes =
        sizeof(float) * static_cast<std::size_t>(info.width) * static_cast<std::size_t>(source_.frames());
    rows = std::min(rows, static_cast<int>(kLoopBytes / row_bytes));
    if (rows == 0)
      throw bad_input(source_.name(), "period_ns", fmt::format("{} frames of {} columns", source_.frames(), info.width),
                      fmt::format("a row's loop of at most {} MiB", kLoopBytes >> 20));
    if (rows > 16 && rows < info.height) rows -= rows % 16;  // whole blocks of the file
  }
  std::vector<Region> regions;
  for (int y = 0; y < info.height; y += rows) regions.push_back({y, std::min(info.height, y + rows)});
  return regions;
}

}  // namespace pecs::sensor
