#pragma once
#include <cstdint>

namespace pecs::sensor {

// Constants of the interval that starts at frame k, and those for the slope at frame k + 1.
struct IntervalTimes {
  double t0_us, t1_us;
  float h_us, per_h, per_next;                 // duration, 1 / duration, 1 / duration of the next interval
  float weight_this, weight_next, weight_sum;  // of the harmonic mean: of 1 / slope of this interval and of the next
  std::int64_t step;                           // index of the interval since the start
};

}  // namespace pecs::sensor
