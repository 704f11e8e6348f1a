#pragma once
// Light of a keyframe between its pixels, where that takes more than the kernel's interpolation: beside the border and
// beside nearer surfaces.
#include <limits>

#include "motion/landing.h"

namespace pecs::sensor::motion {

constexpr float kDark = std::numeric_limits<float>::quiet_NaN();  // not seen

// Catmull-Rom, clamped to the range of the four pixels around; beyond the border the border's pixels go on.
float cubic(const Surfaces& from, const float* plane, float u, float v);

struct Light {
  float value = kDark;
  bool soiled = false;  // by a nearer surface
};

// Beside a nearer surface: of the four pixels around those that show this surface and no other.
Light own_light(const Surfaces& from, const float* plane, const Seen& seen);

// A rim's light with what is behind it now (NaN: not known), in place of what was behind it in the keyframe.
float rim_light(const Surfaces& from, const float* plane, const Seen& rim, float behind);

// a^(1-s) b^s, as blend_run.
float blend(float a, float b, float s);

}  // namespace pecs::sensor::motion
