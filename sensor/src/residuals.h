#pragma once
// What carried light lacks between two keyframes, from pictures rendered at instants between them
// (docs/exr_stack.md, Pictures between instants).
#include <cstdint>
#include <span>
#include <vector>

namespace pecs::sensor {

class Residuals {
 public:
  // At the fraction s of the interval, rising from call to call: r = ln(rendered / carried) of the pixels that were
  // rendered. 0 <= s <= 1; planes of one size.
  void add(double s, std::span<const float> rendered, std::span<const float> carried);
  // After the last add.
  void close();
  // Multiplies a carried plane by exp(r) at s: linear between the instants at which the pixel was rendered, 0 at the
  // keyframes. In the caller's TBB arena.
  void apply(double s, std::span<float> carried) const;

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

}  // namespace pecs::sensor
