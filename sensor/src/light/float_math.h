#pragma once
// ln and exp of floats, by those of doubles: the logf and expf of C libraries differ in the last bit, and so would
// events.
#include <cmath>

namespace pecs::sensor {

inline float log_of(float x) { return static_cast<float>(std::log(static_cast<double>(x))); }
inline float exp_of(float x) { return static_cast<float>(std::exp(static_cast<double>(x))); }

}  // namespace pecs::sensor
