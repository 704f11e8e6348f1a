#pragma once
// How far two recordings of one scene lie apart in time.
#include <cstdint>
#include <optional>

#include "pecs/events/recording.h"

namespace pecs::metrics {

struct TimeShift {
  double shift_us = 0;         // the simulation's events come this much later than the real ones (negative: earlier)
  double correlation = 0;      // of the polarity pictures at that shift, -1..1
  double correlation_now = 0;  // at no shift
};

// Compares polarity pictures (ON minus OFF, in blocks of about 1/40 of the width) of `sim` with those of `real` at
// shifts up to `range_us`. Empty when a stream has too few events, or none of the shifts overlaps enough.
std::optional<TimeShift> time_shift(const events::Recording& real, const events::Recording& sim, std::int64_t range_us);

}  // namespace pecs::metrics
