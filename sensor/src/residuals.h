#pragma once
// What carried light lacks between two keyframes, from pictures rendered at instants between them
// (docs/reference/exr_stack.md, Pictures between instants).
#include <cstdint>
#include <span>
#include <vector>

#include "pecs/sensor/motion.h"
#include "pecs/sensor/photocurrent.h"

namespace pecs::sensor {

class Residuals {
 public:
  // At the fraction s of the interval, rising from call to call: r = ln(rendered / carried) of the pixels that were
  // rendered. 0 <= s <= 1; planes of one size.
  void add(double s, std::span<const float> rendered, std::span<const float> carried);
  // After the last add.
  void close();
  // Multiplies a carried plane by exp(r) at s: linear between the instants at which the pixel was rendered, 0 at the
  // keyframes. Or its pixels [begin, end) alone. In the caller's TBB arena.
  void apply(double s, std::span<float> carried, std::size_t begin = 0, std::size_t end = SIZE_MAX) const;

 private:
  struct Residual {
    float s, r;
  };
  struct Found {
    std::uint32_t pixel;
    Residual residual;
  };
  std::vector<Found> found_;           // until close()
  std::vector<std::uint32_t> pixels_;  // that have some, rising
  std::vector<std::uint32_t> first_;   // of each pixel, and the end
  std::vector<Residual> residuals_;    // by pixel, then s
};

// Of the interval that begins at a frame, from its pictures; their fractions are added to `instants`. first, second:
// the light at its ends, with subpixels.
Residuals residuals_of(PhotocurrentReader& light, std::int64_t frame, double length_us, const Carrier& carrier,
                       const float* first, const float* second, std::vector<double>& instants);

}  // namespace pecs::sensor
