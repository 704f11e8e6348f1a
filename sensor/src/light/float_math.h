#pragma once
// The least photocurrent; ln and exp of floats, by those of doubles: the logf and expf of C libraries differ in the
// last bit, and so would events.
#include <cmath>

namespace pecs::sensor {

constexpr float kDarkest_fa = 1e-4f;  // 0.6 electrons/s; less is as dark to a pixel, and has no ratio

inline float log_of(float x) { return static_cast<float>(std::log(static_cast<double>(x))); }
inline float exp_of(float x) { return static_cast<float>(std::exp(static_cast<double>(x))); }

}  // namespace pecs::sensor
