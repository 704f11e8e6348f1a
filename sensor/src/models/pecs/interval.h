#pragma once
#include <algorithm>
#include <cstdint>

namespace pecs::sensor {

// The amplifier's output at the end of an interval, from V and its slopes per interval at start and end (amplifier.h).
// x: b times the duration; decay: e^-x.
struct AmplifierWeights {
  float x = 0, decay = 0, v0 = 0, v1 = 0, d0 = 0, d1 = 0;
};

// Overshoot of ln I beyond both frames of an interval that is allowed whatever the frames around are.
inline constexpr double kFreeOvershoot = 0.05;

// Constants of the slope at a frame between intervals of h0 and h1 us (cubic.h, inner_slope).
struct SlopeWeights {
  float share = 0, blend = 0;  // of h0 in both intervals; weight of the parabola through three frames
  // Limits: where light is smooth, the extremum of a parabola is within an interval (of even ones) of the frame; a
  // cubic goes beyond its frames by a quarter of its slopes at most.
  float bend = 0, free_slope = 0;
  SlopeWeights() = default;
  SlopeWeights(double h0, double h1) {
    const double longer = std::max(h0, h1), ratio = std::min(h0, h1) / longer;
    share = static_cast<float>(h0 / (h0 + h1));
    blend = 0.1f + 0.9f * share;  // share: one order more, but too fast at four frames a period
    bend = static_cast<float>(std::min(2.0, 4 * ratio * ratio));
    free_slope = static_cast<float>(4 * kFreeOvershoot / longer);
  }
};

// References are floats below 32: they change by the leak of short intervals without a rounding error, which would slow
// the leak, since it is counted in their last place.
inline constexpr double kLeakUnit = 0x1p-19;

// Constants of the interval that starts at frame k, and those for the slope at frame k + 1.
struct IntervalTimes {
  double t0_us, t1_us;
  float h_us, per_h, per_next;  // duration, 1 / duration, 1 / duration of the next interval
  float leak;                   // of V: a multiple of kLeakUnit
  SlopeWeights slope;
  std::int64_t step;                // index of the interval since the start
  AmplifierWeights amplifier = {};  // without amplifier: 0
};

}  // namespace pecs::sensor
