#pragma once
// Estimates the time shift between two recordings of one scene.
#include <cstdint>
#include <optional>

#include "pecs/events/recording.h"

namespace pecs::metrics {

struct TimeShift {
  double shift_us = 0;               // delay of the simulation relative to the recording (negative: earlier)
  double correlation = 0;            // of the polarity pictures at that shift, -1..1
  double correlation_unshifted = 0;  // at no shift
};

// Correlates polarity pictures (ON minus OFF, in blocks of about 1/40 of the width) of `sim` with those of `real` at
// shifts up to `range_us`. Empty when a stream has too few events, or no shift has enough overlap.
std::optional<TimeShift> time_shift(const events::Recording& real, const events::Recording& sim, std::int64_t range_us);

}  // namespace pecs::metrics
