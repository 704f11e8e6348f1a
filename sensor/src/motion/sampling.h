#pragma once
// Light of a keyframe between its pixels where the kernel's interpolation does not apply: at the picture's border and
// at occlusion boundaries.
#include <limits>
#include <memory>
#include <vector>

#include "motion/edges.h"
#include "motion/kernel.h"
#include "motion/landing.h"

namespace pecs::sensor::motion {

constexpr float kDark = std::numeric_limits<float>::quiet_NaN();  // not visible

// A plane of light with the coefficients of its interpolating cubic spline, which is sharper than other kernels of four
// pixels.
class SplinePlane {
 public:
  // The caller keeps both. In the caller's TBB arena. Coefficients treat a value that is not finite as equal to its
  // left neighbour.
  SplinePlane(const float* plane, const Surfaces& from);
  const float* plane() const { return plane_; }
  CubicPlane cubic() const { return {plane_, coefficients_.data(), width_, height_}; }
  const Edges& edges() const { return *edges_; }
  // As cubic_run. Beyond the border, the border's pixels are repeated.
  float at(float u, float v) const;

 private:
  const float* plane_;
  int width_, height_;
  std::vector<float> coefficients_;
  std::unique_ptr<Edges> edges_;
};

struct SampledLight {
  float value = kDark;
  bool mixed = false;  // may contain light of an occluder
};

// Near an occlusion boundary: interpolates those of the four nearest pixels that show only this surface.
SampledLight own_light(const Surfaces& from, const SplinePlane& spline, const VisiblePoint& seen);

// Light of a boundary pixel, with the light behind it in the keyframe replaced by `behind` (NaN: unknown).
float boundary_light(const Surfaces& from, const SplinePlane& spline, const VisiblePoint& boundary, float behind);

// a^(1-s) b^s, with the exceptions of blend_run.
float blend(float a, float b, float s);

}  // namespace pecs::sensor::motion
