#pragma once
// Light of a keyframe between its pixels, where that takes more than the kernel's interpolation: beside the border and
// beside nearer surfaces.
#include <limits>
#include <vector>

#include "motion/landing.h"

namespace pecs::sensor::motion {

constexpr float kDark = std::numeric_limits<float>::quiet_NaN();  // not seen

// A plane of light with the coefficients of the cubic spline through it: sharper than other kernels of four pixels.
class Picture {
 public:
  // In the caller's TBB arena. What is not finite counts as its neighbour there.
  Picture(const float* plane, int width, int height);
  const float* plane() const { return plane_; }
  const float* coefficients() const { return coefficients_.data(); }
  // As cubic_run; beyond the border the border's pixels go on.
  float at(float u, float v) const;

 private:
  const float* plane_;
  int width_, height_;
  std::vector<float> coefficients_;
};

struct Light {
  float value = kDark;
  bool soiled = false;  // by a nearer surface
};

// Beside a nearer surface: of the four pixels around those that show this surface and no other.
Light own_light(const Surfaces& from, const float* plane, const Seen& seen);

// A rim's light with what is behind it now (NaN: not known), in place of what was behind it in the keyframe.
float rim_light(const Surfaces& from, const Picture& picture, const Seen& rim, float behind);

// a^(1-s) b^s, as blend_run.
float blend(float a, float b, float s);

}  // namespace pecs::sensor::motion
