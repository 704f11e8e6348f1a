// Included once per instruction set by Highway's foreach_target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "motion/kernel.cpp"
#include <hwy/foreach_target.h>
// then
#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

#include <limits>

#include "motion/kernel.h"
#include "motion/surfaces.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::sensor::motion::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using F = hn::ScalableTag<float>;
using I32 = hn::RebindToSigned<F>;
using U16 = hn::Rebind<std::uint16_t, F>;
using V = hn::Vec<F>;
using M = hn::Mask<F>;
static_assert(hn::MaxLanes(F()) <= kSpare);

void Paths(const PathArguments& a) {
  const F f;
  const V here = hn::Set(f, a.here), there = hn::Set(f, a.there);
  for (std::size_t i = 0; i < a.count; i += hn::Lanes(f)) {
    const auto load = [&](std::size_t c) { return hn::LoadU(f, a.channels + c * a.stride + i); };
    V x = hn::Zero(f), y = hn::Zero(f);
    for (std::size_t q = 0; q < kQuarters; ++q) {
      const V weight = hn::Set(f, a.quarters[q]);
      x = hn::MulAdd(weight, load(2 * q), x);
      y = hn::MulAdd(weight, load(2 * q + 1), y);
    }
    hn::StoreU(x, f, a.x + i);
    hn::StoreU(y, f, a.y + i);
    hn::StoreU(hn::MulAdd(here, load(kPathChannels - 2), hn::Mul(there, load(kPathChannels - 1))), f, a.z + i);
  }
}

void LandRun(const LandingArguments& a) {
  const F f;
  const I32 i32;
  const V one = hn::Set(f, 1.0f), half = hn::Set(f, 0.5f);
  for (std::size_t i = 0; i < a.count; i += hn::Lanes(f)) {
    const auto flags = hn::PromoteTo(i32, hn::LoadU(U16(), a.flags + i));
    const auto has = [&](std::uint16_t flag) {
      return hn::RebindMask(f, hn::TestBit(flags, hn::Set(i32, static_cast<std::int32_t>(flag))));
    };
    const M right = has(kRight), left = has(kLeft), down = has(kDown), up = has(kUp);
    const auto slope = [&](const float* q, M ahead, M behind, std::ptrdiff_t step) {
      const V c = hn::LoadU(f, q + i);
      const V next = hn::IfThenElseZero(ahead, hn::Sub(hn::LoadU(f, q + i + step), c));
      const V last = hn::IfThenElseZero(behind, hn::Sub(c, hn::LoadU(f, q + i - step)));
      const V sum = hn::Add(next, last);
      return hn::IfThenElse(hn::And(ahead, behind), hn::Mul(half, sum), sum);
    };
    const V dx = hn::LoadU(f, a.x + i), dy = hn::LoadU(f, a.y + i);
    const V px = hn::Add(hn::Set(f, a.first_x), hn::ConvertTo(f, hn::Iota(i32, static_cast<std::int32_t>(i))));
    const V py = hn::Set(f, a.row_y);
    const V at_x = hn::Add(px, dx), at_y = hn::Add(py, dy);
    const V to_x = hn::Floor(hn::Add(at_x, half)), to_y = hn::Floor(hn::Add(at_y, half));
    const V rx = hn::Sub(to_x, at_x), ry = hn::Sub(to_y, at_y);

    V xx = hn::Add(one, slope(a.x, right, left, 1)), xy = slope(a.x, down, up, a.stride);
    V yx = slope(a.y, right, left, 1), yy = hn::Add(one, slope(a.y, down, up, a.stride));
    V det = hn::NegMulAdd(xy, yx, hn::Mul(xx, yy));
    const M turns = hn::Not(hn::Gt(det, hn::Set(f, 0.1f)));  // the surface turns away
    xx = hn::IfThenElse(turns, one, xx), yy = hn::IfThenElse(turns, one, yy);
    xy = hn::IfThenZeroElse(turns, xy), yx = hn::IfThenZeroElse(turns, yx);
    det = hn::IfThenElse(turns, one, det);
    const V per = hn::Div(one, det);
    const V u = hn::Mul(per, hn::NegMulAdd(xy, ry, hn::Mul(yy, rx)));
    const V v = hn::Mul(per, hn::NegMulAdd(yx, rx, hn::Mul(xx, ry)));
    hn::StoreU(hn::Add(px, u), f, a.u + i);
    hn::StoreU(hn::Add(py, v), f, a.v + i);
    const V z =
        hn::MulAdd(slope(a.z, right, left, 1), u, hn::MulAdd(slope(a.z, down, up, a.stride), v, hn::LoadU(f, a.z + i)));
    hn::StoreU(z, f, a.depth + i);
    const V outside = hn::Set(f, -1e6f);
    const M known = hn::And(has(kKnown), hn::Lt(hn::Max(hn::Abs(to_x), hn::Abs(to_y)), hn::Set(f, 1e6f)));
    hn::StoreU(hn::ConvertTo(i32, hn::IfThenElse(known, to_x, outside)), i32, a.column + i);
    hn::StoreU(hn::ConvertTo(i32, hn::IfThenElse(known, to_y, outside)), i32, a.row + i);
  }
}

void Contested(const float* depths, std::ptrdiff_t stride, float none, std::size_t count, std::uint8_t* out) {
  const F f;
  const hn::Rebind<std::uint8_t, F> u8;
  const I32 i32;
  for (std::size_t i = 0; i < count; i += hn::Lanes(f)) {
    const auto row = [&](const float* at) {
      return hn::Min(hn::LoadU(f, at), hn::Min(hn::LoadU(f, at - 1), hn::LoadU(f, at + 1)));
    };
    const float* at = depths + i;
    const V here = hn::LoadU(f, at), least = hn::Min(row(at), hn::Min(row(at - stride), row(at + stride)));
    const M look = hn::Or(hn::Ge(here, hn::Set(f, none)), hn::Lt(least, hn::Mul(here, hn::Set(f, 0.99f))));
    const auto bytes = hn::IfThenElseZero(hn::RebindMask(i32, look), hn::Set(i32, 1));
    hn::StoreU(hn::DemoteTo(u8, bytes), u8, out + i);
  }
}

// sqrt(3) z^|k|, z = sqrt(3) - 2 (Unser, Aldroubi, Eden, IEEE Trans. Signal Process. 41, 1993), cut off; its sum is 1.
constexpr float kSpline[8] = {1.73217656f,    -0.464135309f,   0.124364681f,    -0.0333234159f,
                              0.00892898238f, -0.00239251362f, 0.000641072092f, -0.000171774749f};

void SplineRun(const float* const (&taps)[kSplineTaps], std::size_t count, float* out) {
  const F f;
  for (std::size_t i = 0; i < count; i += hn::Lanes(f)) {
    V sum = hn::Mul(hn::Set(f, kSpline[0]), hn::LoadU(f, taps[7] + i));
    for (int k = 1; k < 8; ++k)
      sum = hn::MulAdd(hn::Set(f, kSpline[k]), hn::Add(hn::LoadU(f, taps[7 - k] + i), hn::LoadU(f, taps[7 + k] + i)),
                       sum);
    hn::StoreU(sum, f, out + i);
  }
}

// Cubic B-spline weights of the pixels -1, 0, 1, 2 at the fraction x between 0 and 1.
HWY_INLINE void b_spline(V x, V (&w)[4]) {
  const F f;
  const V sixth = hn::Set(f, 1.0f / 6), one = hn::Set(f, 1.0f), half = hn::Set(f, 0.5f), y = hn::Sub(one, x);
  const V x2 = hn::Mul(x, x), y2 = hn::Mul(y, y), two_thirds = hn::Set(f, 2.0f / 3);
  w[0] = hn::Mul(sixth, hn::Mul(y2, y));
  w[1] = hn::NegMulAdd(x2, hn::NegMulAdd(half, x, one), two_thirds);
  w[2] = hn::NegMulAdd(y2, hn::NegMulAdd(half, y, one), two_thirds);
  w[3] = hn::Mul(sixth, hn::Mul(x2, x));
}

void CubicRun(const CubicPlane& plane, const float* u, const float* v, std::size_t count, float* out,
              std::int32_t* upper_left) {
  const auto& [values, coefficients, width, height] = plane;
  const F f;
  const I32 i32;
  const hn::FixedTag<float, 4> f4;
  constexpr std::size_t kMost = hn::MaxLanes(F());
  const std::size_t lanes = hn::Lanes(f);
  const std::ptrdiff_t below = width;  // to the next row
  HWY_ALIGN float weights_x[4 * kMost], weights_y[4][kMost], sums[4 * kMost], upper[4 * kMost], lower[4 * kMost];
  for (std::size_t i = 0; i < count; i += lanes) {
    const auto inside = [&](V at, int size) {
      return hn::Min(hn::Max(at, hn::Set(f, 1.0f)), hn::Set(f, static_cast<float>(size - 3)));
    };
    const V at_x = hn::LoadU(f, u + i), at_y = hn::LoadU(f, v + i);
    const V x = inside(hn::Floor(at_x), width), y = inside(hn::Floor(at_y), height);
    V wx[4], wy[4];
    b_spline(hn::Sub(at_x, x), wx);
    b_spline(hn::Sub(at_y, y), wy);
    hn::StoreInterleaved4(wx[0], wx[1], wx[2], wx[3], f, weights_x);
    for (int k = 0; k < 4; ++k) hn::Store(wy[k], f, weights_y[k]);
    const auto offset = hn::Add(hn::Mul(hn::ConvertTo(i32, y), hn::Set(i32, width)), hn::ConvertTo(i32, x));
    hn::StoreU(offset, i32, upper_left + i);
    for (std::size_t k = 0; k < lanes; ++k) {
      const std::ptrdiff_t first = upper_left[i + k] - width - 1;
      const float* at = coefficients + first;
      const auto w = [&](int row) { return hn::Set(f4, weights_y[row][k]); };
      auto sum = hn::Mul(w(0), hn::LoadU(f4, at));
      for (int row = 1; row < 4; ++row) sum = hn::MulAdd(w(row), hn::LoadU(f4, at + row * below), sum);
      hn::Store(hn::Mul(sum, hn::Load(f4, weights_x + 4 * k)), f4, sums + 4 * k);
      hn::Store(hn::LoadU(f4, values + first + below), f4, upper + 4 * k);
      hn::Store(hn::LoadU(f4, values + first + 2 * below), f4, lower + 4 * k);
    }
    V s[4], a[4], b[4];
    hn::LoadInterleaved4(f, sums, s[0], s[1], s[2], s[3]);
    hn::LoadInterleaved4(f, upper, a[0], a[1], a[2], a[3]);
    hn::LoadInterleaved4(f, lower, b[0], b[1], b[2], b[3]);
    const V sum = hn::Add(hn::Add(s[0], s[1]), hn::Add(s[2], s[3]));
    const V least = hn::Min(hn::Min(a[1], a[2]), hn::Min(b[1], b[2]));
    const V most = hn::Max(hn::Max(a[1], a[2]), hn::Max(b[1], b[2]));
    const V beyond = hn::Mul(hn::Set(f, kBeyond), hn::Sub(most, least));
    const V low = hn::Max(hn::Sub(least, beyond), hn::Mul(hn::Set(f, 1 - kBeyond), least));
    V value = hn::Min(hn::Max(sum, low), hn::Add(most, beyond));
    value = hn::IfThenElse(hn::And(hn::Eq(at_x, x), hn::Eq(at_y, y)), a[1], value);
    // All four are compared: Min and Max may pass over a NaN.
    const V all = hn::Add(hn::Add(hn::Abs(a[1]), hn::Abs(a[2])), hn::Add(hn::Abs(b[1]), hn::Abs(b[2])));
    const M finite = hn::Lt(all, hn::Set(f, std::numeric_limits<float>::infinity()));
    hn::StoreU(hn::IfThenElse(finite, value, hn::Set(f, std::numeric_limits<float>::quiet_NaN())), f, out + i);
  }
}

// In double precision: the differences of the cubes cancel.
void LineShares(const LinesArguments& lines, float* out) {
  const hn::ScalableTag<double> f;
  const hn::Rebind<float, decltype(f)> narrow;
  using V2 = hn::Vec<decltype(f)>;
  const V2 half = hn::Set(f, 0.5), least = hn::Set(f, kLeastSlope), six = hn::Set(f, 6.0), zero = hn::Zero(f);
  for (std::size_t i = 0; i < lines.count; i += hn::Lanes(f)) {
    const auto load = [&](const float* from) { return hn::PromoteTo(f, hn::LoadU(narrow, from + i)); };
    const V2 a = hn::Max(hn::Abs(load(lines.nx)), least), b = hn::Max(hn::Abs(load(lines.ny)), least);
    const V2 width = load(lines.width), sum = hn::Add(a, b);
    const auto cube = [&](V2 t) {
      const V2 p = hn::Max(t, zero);
      return hn::Mul(hn::Mul(p, p), p);
    };
    const auto integral = [&](V2 t) {  // of the share, times 6 a b, over t
      const V2 beyond = hn::Add(cube(hn::Sub(t, a)), cube(hn::Sub(t, b)));
      return hn::Sub(hn::Add(cube(t), cube(hn::Sub(t, sum))), beyond);
    };
    const V2 corner = hn::MulAdd(half, sum, load(lines.d)), reach = hn::Mul(half, width);
    const V2 area = hn::Sub(integral(hn::Add(corner, reach)), integral(hn::Sub(corner, reach)));
    const V2 share = hn::Div(area, hn::Mul(hn::Mul(six, width), hn::Mul(a, b)));
    hn::StoreU(hn::DemoteTo(narrow, hn::Min(hn::Max(share, zero), hn::Set(f, 1.0))), narrow, out + i);
  }
}

void BlendRun(const float* a_run, const float* b_run, float s, std::size_t count, float* out) {
  const F f;
  const V zero = hn::Zero(f), weight = hn::Set(f, s), infinite = hn::Set(f, std::numeric_limits<float>::infinity());
  for (std::size_t i = 0; i < count; i += hn::Lanes(f)) {
    const V a = hn::LoadU(f, a_run + i), b = hn::LoadU(f, b_run + i);
    const M has_a = hn::Lt(hn::Abs(a), infinite), has_b = hn::Lt(hn::Abs(b), infinite);
    const M lit = hn::And(hn::Gt(a, zero), hn::Gt(b, zero)), same = hn::Eq(a, b);
    V mixed = a;
    if (!hn::AllTrue(f, same)) {
      const V ratio =
          hn::IfThenElse(hn::AndNot(same, hn::And(lit, hn::And(has_a, has_b))), hn::Div(b, a), hn::Set(f, 1.0f));
      mixed = hn::Mul(a, hn::Exp(f, hn::Mul(weight, hn::Log(f, ratio))));
      mixed = hn::IfThenElse(lit, mixed, hn::MulAdd(weight, hn::Sub(b, a), a));
      mixed = hn::IfThenElse(same, a, mixed);
    }
    hn::StoreU(hn::IfThenElse(has_a, hn::IfThenElse(has_b, mixed, a), b), f, out + i);
  }
}

}  // namespace pecs::sensor::motion::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace pecs::sensor::motion {
HWY_EXPORT(Paths);
HWY_EXPORT(LandRun);
HWY_EXPORT(Contested);
HWY_EXPORT(SplineRun);
HWY_EXPORT(CubicRun);
HWY_EXPORT(LineShares);
HWY_EXPORT(BlendRun);
void paths(const PathArguments& arguments) { HWY_DYNAMIC_DISPATCH(Paths)(arguments); }
void land_run(const LandingArguments& arguments) { HWY_DYNAMIC_DISPATCH(LandRun)(arguments); }
void contested(const float* depths, std::ptrdiff_t stride, float none, std::size_t count, std::uint8_t* out) {
  HWY_DYNAMIC_DISPATCH(Contested)(depths, stride, none, count, out);
}
void spline_run(const float* const (&taps)[kSplineTaps], std::size_t count, float* out) {
  HWY_DYNAMIC_DISPATCH(SplineRun)(taps, count, out);
}
void cubic_run(const CubicPlane& plane, const float* u, const float* v, std::size_t count, float* out,
               std::int32_t* upper_left) {
  HWY_DYNAMIC_DISPATCH(CubicRun)(plane, u, v, count, out, upper_left);
}
void line_shares(const LinesArguments& lines, float* out) { HWY_DYNAMIC_DISPATCH(LineShares)(lines, out); }
void blend_run(const float* a, const float* b, float s, std::size_t count, float* out) {
  HWY_DYNAMIC_DISPATCH(BlendRun)(a, b, s, count, out);
}
}  // namespace pecs::sensor::motion
#endif
