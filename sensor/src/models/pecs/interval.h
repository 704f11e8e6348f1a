#pragma once
#include <cstdint>

namespace pecs::sensor {

// The amplifier's output at the end of an interval, from V and its slopes per interval at start and end (amplifier.h).
// x: b times the duration; decay: e^-x.
struct AmplifierWeights {
  float x = 0, decay = 0, v0 = 0, v1 = 0, d0 = 0, d1 = 0;
};

// Constants of the interval that starts at frame k, and those for the slope at frame k + 1.
struct IntervalTimes {
  double t0_us, t1_us;
  float h_us, per_h, per_next;                 // duration, 1 / duration, 1 / duration of the next interval
  float weight_this, weight_next, weight_sum;  // of the harmonic mean: of 1 / slope of this interval and of the next
  std::int64_t step;                           // index of the interval since the start
  AmplifierWeights amplifier = {};             // without amplifier: 0
};

}  // namespace pecs::sensor
