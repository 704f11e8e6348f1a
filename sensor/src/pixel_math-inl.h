// Included once per instruction set, after hwy/highway.h: what the kernels of pixels share.
#if defined(PECS_PIXEL_MATH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef PECS_PIXEL_MATH_INL_H_
#undef PECS_PIXEL_MATH_INL_H_
#else
#define PECS_PIXEL_MATH_INL_H_
#endif

#include <hwy/highway.h>

#include <algorithm>
#include <cstring>
#include <vector>

#include "pixel_kernel.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::sensor::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using F = hn::ScalableTag<float>;
using I32 = hn::RebindToSigned<F>;
using U32 = hn::RebindToUnsigned<F>;
using V = hn::Vec<F>;
using VU = hn::Vec<U32>;
using M = hn::Mask<F>;

constexpr float kFloor_fa = 1e-4f;  // 0.6 electrons/s: less light than this is darkness

// ln x for positive, finite, normal x: x = 2^e m with m in [sqrt(1/2), sqrt(2)), then the minimax polynomial of
// Cephes' logf; relative error 1e-7.
HWY_INLINE V ln(V x) {
  const F f;
  const I32 i;
  const auto bits = hn::BitCast(i, x);
  const auto e = hn::ShiftRight<23>(hn::Sub(bits, hn::Set(i, 0x3f3504f3)));
  const V m = hn::Sub(hn::BitCast(f, hn::Sub(bits, hn::ShiftLeft<23>(e))), hn::Set(f, 1.0f));
  const V exponent = hn::ConvertTo(f, e);
  const V z = hn::Mul(m, m);
  V p = hn::Set(f, 7.0376836292e-2f);
  for (const float c : {-1.1514610310e-1f, 1.1676998740e-1f, -1.2420140846e-1f, 1.4249322787e-1f, -1.6668057665e-1f,
                        2.0000714765e-1f, -2.4999993993e-1f, 3.3333331174e-1f})
    p = hn::MulAdd(p, m, hn::Set(f, c));
  V y = hn::Mul(hn::Mul(p, m), z);
  y = hn::MulAdd(exponent, hn::Set(f, -2.12194440e-4f), y);
  y = hn::NegMulAdd(hn::Set(f, 0.5f), z, y);
  return hn::MulAdd(exponent, hn::Set(f, 0.693359375f), hn::Add(m, y));
}

// ln of the photocurrent [fA] of a plane's values; `before` where that is not finite.
HWY_INLINE V ln_current(const KernelArguments& a, V value, V before) {
  const F f;
  const V current = hn::MulAdd(value, hn::Set(f, a.gain_fa), hn::Set(f, a.dark_fa));
  const M finite = hn::Lt(current, hn::Set(f, 1e30f));  // false for NaN
  return hn::IfThenElse(finite, ln(hn::Max(current, hn::Set(f, kFloor_fa))), before);
}

// Slope at a frame between two intervals, from their slopes: weighted harmonic mean, 0 at an extremum.
HWY_INLINE V inner_slope(V s0, V s1, const IntervalTimes& t) {
  const F f;
  const V product = hn::Mul(s0, s1);
  const V below = hn::MulAdd(hn::Set(f, t.weight_this), s1, hn::Mul(hn::Set(f, t.weight_next), s0));
  const V slope = hn::Div(hn::Mul(hn::Set(f, t.weight_sum), product), below);
  return hn::IfThenElseZero(hn::Gt(product, hn::Zero(f)), slope);
}

// Slope at the first or last frame: the parabola's, kept monotone. s0, h0: the interval that ends here.
HWY_INLINE V end_slope(V s0, V s1, float h0, float h1) {
  const F f;
  const V slope =
      hn::Mul(hn::Set(f, 1 / (h0 + h1)), hn::Sub(hn::Mul(hn::Set(f, 2 * h0 + h1), s0), hn::Mul(hn::Set(f, h0), s1)));
  const V most = hn::Mul(hn::Set(f, 3.0f), s0);
  const M turns = hn::Lt(hn::Mul(s0, s1), hn::Zero(f));
  const V limited = hn::IfThenElse(hn::And(turns, hn::Gt(hn::Abs(slope), hn::Abs(most))), most, slope);
  return hn::IfThenElseZero(hn::Gt(hn::Mul(limited, s0), hn::Zero(f)), limited);
}

// Writes the first `lanes` of v; those beyond belong to others.
HWY_INLINE void store_lanes(V v, std::uint32_t lanes, float* to) {
  const F f;
  hn::StoreU(lanes == hn::Lanes(f) ? v : hn::IfThenElse(hn::FirstN(f, lanes), v, hn::LoadU(f, to)), f, to);
}

// Frames lie far apart in memory: a block of pixels is copied from all of them first.
class Block {
 public:
  static constexpr std::uint32_t kPixels = 512;
  static constexpr std::size_t kStride = kPixels + kMaxLanes;  // not a power of two: rows share few cache sets

  explicit Block(const KernelArguments& a) : a_(a), values_(a.planes.size() * kStride) {}
  // Pixels [first, end) of the first planes; lanes beyond them see light 1.
  void gather(std::uint32_t first, std::uint32_t end, std::size_t planes) {
    const std::size_t count = end - first;
    for (std::size_t i = 0; i < planes; ++i) {
      float* to = values_.data() + i * kStride;
      std::memcpy(to, a_.planes[i] + first, count * sizeof(float));
      std::fill_n(to + count, kMaxLanes, 1.0f);
    }
  }
  const float* from(std::uint32_t offset) const { return values_.data() + offset; }  // rows kStride apart

 private:
  const KernelArguments& a_;
  std::vector<float> values_;
};

}  // namespace pecs::sensor::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif
