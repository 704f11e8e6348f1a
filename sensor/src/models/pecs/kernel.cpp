// Included once per instruction set by Highway's foreach_target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "models/pecs/kernel.cpp"
#include <hwy/foreach_target.h>
// then
#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "models/pecs/kernel.h"
#include "models/pecs/math-inl.h"
#include "pecs/sensor/random.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::sensor::HWY_NAMESPACE {

// (1 - e^-x) / x for x >= 0.
HWY_INLINE V phi1(V x) {
  const F f;
  V series = hn::Set(f, 1.0f / 5040);
  for (const float c : {-1.0f / 720, 1.0f / 120, -1.0f / 24, 1.0f / 6, -0.5f, 1.0f})
    series = hn::MulAdd(series, x, hn::Set(f, c));
  const M small = hn::Lt(x, hn::Set(f, 0.5f));
  if (hn::AllTrue(f, small)) return series;
  const V exact = hn::Div(hn::Sub(hn::Set(f, 1.0f), hn::Exp(f, hn::Neg(x))), x);
  return hn::IfThenElse(small, series, exact);
}

// High and low halves of the products of 32-bit lanes with a number.
HWY_INLINE void multiply(VU a, std::uint32_t by, VU& high, VU& low) {
  const U32 u;
  const hn::RepartitionToWide<U32> wide;
  const VU b = hn::Set(u, by);
  const auto even = hn::MulEven(a, b), odd = hn::MulEven(hn::BitCast(u, hn::ShiftRight<32>(hn::BitCast(wide, a))), b);
  high = hn::OddEven(hn::BitCast(u, odd), hn::BitCast(u, hn::ShiftRight<32>(even)));
  low = hn::OddEven(hn::BitCast(u, hn::ShiftLeft<32>(odd)), hn::BitCast(u, even));
}

// random.h: random4 for a run of pixels.
HWY_INLINE void philox(VU c[4], std::uint64_t key) {
  const U32 u;
  auto k0 = static_cast<std::uint32_t>(key), k1 = static_cast<std::uint32_t>(key >> 32);
  for (int round = 0; round < 7; ++round) {
    VU ah, al, bh, bl;
    multiply(c[0], 0xD2511F53u, ah, al);
    multiply(c[2], 0xCD9E8D57u, bh, bl);
    c[0] = hn::Xor(hn::Xor(bh, c[1]), hn::Set(u, k0));
    c[2] = hn::Xor(hn::Xor(ah, c[3]), hn::Set(u, k1));
    c[1] = bl;
    c[3] = al;
    k0 += 0x9E3779B9;
    k1 += 0xBB67AE85;
  }
}

// random.h: gaussian.
HWY_INLINE V gaussian(VU r) {
  const F f;
  const I32 i;
  const V x = hn::MulAdd(hn::ConvertTo(f, hn::BitCast(i, hn::Xor(r, hn::Set(U32(), 0x80000000u)))),
                         hn::Set(f, 0x1p-31f), hn::Set(f, 0x1p-32f));
  const V one = hn::Set(f, 1.0f);
  const V inside = hn::Max(hn::Mul(hn::Sub(one, x), hn::Add(one, x)), hn::Set(f, 0x1p-26f));
  const V w = hn::Neg(ln(inside));
  const V central = hn::Sub(w, hn::Set(f, 2.5f));
  V p = hn::Set(f, 2.81022636e-08f);
  for (const float c : {3.43273939e-07f, -3.5233877e-06f, -4.39150654e-06f, 0.00021858087f, -0.00125372503f,
                        -0.00417768164f, 0.246640727f, 1.50140941f})
    p = hn::MulAdd(p, central, hn::Set(f, c));
  const M tail = hn::Ge(w, hn::Set(f, 5.0f));
  if (!hn::AllFalse(f, tail)) {
    const V far = hn::Sub(hn::Sqrt(w), hn::Set(f, 3.0f));
    V q = hn::Set(f, -0.000200214257f);
    for (const float c : {0.000100950558f, 0.00134934322f, -0.00367342844f, 0.00573950773f, -0.0076224613f,
                          0.00943887047f, 1.00167406f, 2.83297682f})
      q = hn::MulAdd(q, far, hn::Set(f, c));
    p = hn::IfThenElse(tail, q, p);
  }
  return hn::Mul(hn::Mul(p, x), hn::Set(f, 1.41421356f));
}

// The charge-type (logistic) photoreceptor (docs/sensor.md): du/dt = a u (I - u), V = ln u, with a = 2 pi * corner per
// ampere. A node charged by the photocurrent I and discharged by a current u that is exponential in V: its corner,
// a I / 2 pi, follows the light, and it answers darkening more slowly than brightening.
//
// In w = 1/u it is linear: dw/dx = 1/I - w, with dx = a I dt. So over a step of exposure x
//   w1 = e^-x w0 + integral over [0, x] of e^-(x-y) g(y) dy,  g = 1/I,
// and with g a polynomial the integral has a closed form: exact for constant light, and stable for any x.

// g: the cubic from g0 to g1 that has slopes d0 and d1 per step at its ends, over x.
HWY_INLINE V receptor_step(V w, V g0, V g1, V d0, V d1, V x) {
  const F f;
  const V one = hn::Set(f, 1.0f);
  // j_n: integral of e^-(x-y) (y/x)^n. j_n = 1 - n j_(n-1) / x; up from e^-x, or down from the series of j_3.
  V series = hn::Set(f, -6.0f / 39916800);
  for (const float c : {6.0f / 3628800, -6.0f / 362880, 6.0f / 40320, -6.0f / 5040, 6.0f / 720, -6.0f / 120, 6.0f / 24})
    series = hn::MulAdd(series, x, hn::Set(f, c));
  V j3 = hn::Mul(x, series);
  V j2 = hn::Mul(hn::Mul(x, hn::Set(f, 1.0f / 3)), hn::Sub(one, j3));
  V j1 = hn::Mul(hn::Mul(x, hn::Set(f, 0.5f)), hn::Sub(one, j2));
  V j0 = hn::Mul(x, hn::Sub(one, j1));
  const M large = hn::Gt(x, one);
  if (!hn::AllFalse(f, large)) {
    const V per_x = hn::Div(one, x);
    j0 = hn::IfThenElse(large, hn::Sub(one, hn::Exp(f, hn::Neg(x))), j0);
    j1 = hn::IfThenElse(large, hn::NegMulAdd(per_x, j0, one), j1);
    j2 = hn::IfThenElse(large, hn::NegMulAdd(hn::Add(per_x, per_x), j1, one), j2);
    j3 = hn::IfThenElse(large, hn::NegMulAdd(hn::Mul(hn::Set(f, 3.0f), per_x), j2, one), j3);
  }
  const V rise = hn::Sub(g1, g0), both = hn::Add(d0, d1);
  const V bend2 = hn::Sub(hn::Mul(hn::Set(f, 3.0f), rise), hn::Add(d0, both));
  const V bend3 = hn::Sub(both, hn::Add(rise, rise));
  return hn::MulAdd(bend3, j3, hn::MulAdd(bend2, j2, hn::MulAdd(d0, j1, hn::MulAdd(j0, hn::Sub(g0, w), w))));
}

// The same where g is straight; also gives e^-x.
HWY_INLINE V straight_step(V w, V g0, V g1, V x, V& e) {
  const V one = hn::Set(F(), 1.0f);
  const V phi = phi1(x);
  e = hn::NegMulAdd(x, phi, one);
  return hn::MulAdd(hn::Sub(g1, g0), hn::Sub(one, phi), hn::MulAdd(e, hn::Sub(w, g0), g0));
}

// c0 + c1 s + c2 s^2 + c3 s^3 in each lane.
struct Cubics {
  V c0, c1, c2, c3;
  V at(V s) const { return hn::MulAdd(hn::MulAdd(hn::MulAdd(c3, s, c2), s, c1), s, c0); }
  V slope(V s) const {
    const F f;
    return hn::MulAdd(hn::MulAdd(hn::Mul(hn::Set(f, 3.0f), c3), s, hn::Add(c2, c2)), s, c1);
  }
  V bend(V s) const { return hn::MulAdd(hn::Mul(hn::Set(F(), 6.0f), c3), s, hn::Add(c2, c2)); }
};

// By values and slopes at 0 and 1.
HWY_INLINE Cubics hermite(V v0, V v1, V m0, V m1) {
  const V rise = hn::Sub(v1, v0), both = hn::Add(m0, m1);
  return {v0, m0, hn::Sub(hn::Mul(hn::Set(F(), 3.0f), rise), hn::Add(m0, both)), hn::Sub(both, hn::Add(rise, rise))};
}
HWY_INLINE Cubics choose(M which, const Cubics& a, const Cubics& b) {
  return {hn::IfThenElse(which, a.c0, b.c0), hn::IfThenElse(which, a.c1, b.c1), hn::IfThenElse(which, a.c2, b.c2),
          hn::IfThenElse(which, a.c3, b.c3)};
}

struct FirstCrossing {
  V at;  // > 1: none
  M on;
};

// The first s >= from where a cubic is >= high (on) or <= low.
HWY_INLINE FirstCrossing first_crossing(const Cubics& q, V from, V low, V high) {
  const F f;
  const V one = hn::Set(f, 1.0f);
  // Monotone pieces end where 3 c3 s^2 + 2 c2 s + c1 = 0.
  const V root2 = hn::NegMulAdd(hn::Mul(hn::Set(f, 3.0f), q.c3), q.c1, hn::Mul(q.c2, q.c2));
  const V sum = hn::Neg(hn::Add(q.c2, hn::CopySign(hn::Sqrt(root2), q.c2)));
  const V r0 = hn::Div(sum, hn::Mul(hn::Set(f, 3.0f), q.c3)), r1 = hn::Div(q.c1, sum);
  const M swap = hn::Gt(r0, r1);
  const V first = hn::IfThenElse(swap, r1, r0), second = hn::IfThenElse(swap, r0, r1);
  const auto inside = [&](V s, V after) { return hn::And(hn::Gt(s, after), hn::Lt(s, one)); };  // false for NaN
  const V e0 = hn::IfThenElse(inside(first, from), first, from);
  const V e1 = hn::IfThenElse(inside(second, e0), second, e0);
  const V q_from = q.at(from), q0 = q.at(e0), q1 = q.at(e1), q2 = q.at(one);
  const auto outside = [&](V v) { return hn::Or(hn::Ge(v, high), hn::Le(v, low)); };
  const M at_once = outside(q_from), in0 = outside(q0), in1 = outside(q1), in2 = outside(q2);

  const V a = hn::IfThenElse(in0, from, hn::IfThenElse(in1, e0, e1));
  const V b = hn::IfThenElse(in0, e0, hn::IfThenElse(in1, e1, one));
  const V qa = hn::IfThenElse(in0, q_from, hn::IfThenElse(in1, q0, q1));
  const V qb = hn::IfThenElse(at_once, q_from, hn::IfThenElse(in0, q0, hn::IfThenElse(in1, q1, q2)));
  const M found = hn::Or(hn::Or(at_once, in0), hn::Or(in1, in2)), on = hn::Ge(qb, high);
  const V level = hn::IfThenElse(on, high, low), up = hn::IfThenElse(on, one, hn::Neg(one));
  const V guess = hn::MulAdd(hn::Sub(b, a), hn::Div(hn::Sub(level, qa), hn::Sub(qb, qa)), a);
  Halley solve(guess, hn::Mul(up, hn::Sub(level, q.c0)), hn::Mul(up, q.c1), hn::Mul(up, q.c2), hn::Mul(up, q.c3), a, b);
  solve.done = hn::Or(at_once, hn::Not(found));
  for (int n = 0; n < 12 && !hn::AllTrue(f, solve.done); ++n) solve.step();
  return {hn::IfThenElse(at_once, from, hn::IfThenElse(found, solve.s, hn::Set(f, 2.0f))), on};
}

// The photoreceptor within an interval, in steps of its own choice: one in steady light, more where it must relax. The
// error of V is about 2e-4.
struct Receptors {
  Cubics light;  // ln I
  V a_h, steepest, steepest_bend;
  V s, w, i, slope;

  // (dV/ds) / (a_h I) = 1 - u / I: of V that follows the light, and of what relaxes towards that. In fast light
  // dV/ds = l' + (l'^2 - l'') / (a_h I) to second order in 1 / (a_h I).
  struct Motion {
    V follows, relaxes;
  };
  Motion motion() const {
    const F f;
    const V x = hn::Mul(a_h, i), per_x = hn::Div(hn::Set(f, 1.0f), x);
    const V second = hn::Mul(hn::MulSub(slope, slope, light.bend(s)), hn::Mul(per_x, per_x));
    const V follows = hn::MulAdd(slope, per_x, hn::IfThenElseZero(hn::Gt(x, hn::Add(steepest, steepest)), second));
    const V one = hn::Set(f, 1.0f);
    return {follows, hn::Sub(hn::Sub(one, hn::Div(one, hn::Mul(w, i))), follows)};
  }
  // dV/ds times ds; a relaxation that is over within the step counts as one of three time constants.
  V slope_of_v(const Motion& m, V ds) const {
    const V x = hn::Mul(hn::Mul(a_h, i), ds);
    return hn::MulAdd(x, m.follows, hn::Mul(hn::Min(x, hn::Set(F(), 3.0f)), m.relaxes));
  }
  // Length of the next step. The error of a cubic through a relaxation of amplitude r is r (ds / time constant)^4 /
  // 384; r: what relaxes now and, in slow light, what the light's bend adds within the step.
  V wanted(const Motion& m) const {
    const F f;
    const V one = hn::Set(f, 1.0f), tolerance = hn::Set(f, 2e-4f);
    const V x = hn::Mul(a_h, hn::Max(i, hn::Div(one, w))), x_1 = hn::Add(one, x);
    const V r = hn::Add(hn::Abs(m.relaxes), hn::IfThenElseZero(hn::Le(x, hn::Add(steepest, steepest)),
                                                               hn::Div(steepest_bend, hn::Mul(x_1, x_1))));
    const V relaxation = hn::Div(hn::Sqrt(hn::Sqrt(hn::Div(hn::Set(f, 384 * 2e-4f), r))), x);
    const V slow = hn::Div(hn::Set(f, 0.5f), steepest);
    return hn::Min(hn::Min(one, slow), hn::IfThenElse(hn::Lt(r, tolerance), one, relaxation));
  }
};

// A block of pixels, frame by frame. First what all pixels have to do, vector by vector; then the exact work, for those
// that may fire. Pictures stand still in most places: what follows from light that stays is kept.
template <bool kReceptor>
class PixelBlock {
 public:
  static constexpr std::uint32_t kPixels = 256;

  explicit PixelBlock(const KernelArguments& a) : a_(a), planes_(a) {}

  // background: of these pixels, by time.
  void run(std::uint32_t first, std::uint32_t end, std::span<const BackgroundEvent> background) {
    first_ = first;
    count_ = end - first;
    vectors_end_ = (count_ + lanes() - 1) / lanes() * lanes();
    background_ = background;
    load();
    planes_.begin(first, count_);
    std::size_t interval = 0;
    for (std::size_t i = 0; i < a_.planes.size(); ++i) {
      const std::int64_t frame = a_.first_frame + static_cast<std::int64_t>(i);
      take_light(frame == 0);
      if (frame == 0) start();
      if (frame > 1) {
        const IntervalTimes& t = a_.intervals[interval++];
        list_moving(t);
        for (std::size_t k = 0; k < moving_count_; ++k) {
          const std::uint32_t p = moving_[k];
          const V l0 = at(l_[0], p), l1 = at(l_[1], p), l2 = at(l_[2], p);
          const V s0 = per(l0, l1, t.per_h), s1 = per(l1, l2, t.per_next);
          if (frame == 2) put(end_slope(s0, s1, t.h_us, 1 / t.per_next), m_[0], p);
          put(inner_slope(s0, s1, t), m_[1], p);
        }
        step(t);
      }
      for (float** row : {l_, i_, g_}) {
        float* oldest = row[0];
        row[0] = row[1], row[1] = row[2], row[2] = oldest;
      }
    }
    if (a_.last && interval < a_.intervals.size()) {
      const IntervalTimes& t = a_.intervals[interval];
      moving_count_ = 0;
      for (std::uint32_t p = 0; p < vectors_end_; p += lanes()) {
        moving_[moving_count_++] = p;
        // No frame follows: the chord is the slope at the end.
        const V s0 = per(at(l_[0], p), at(l_[1], p), t.per_h);
        if (t.step == 0) put(s0, m_[0], p);
        put(s0, m_[1], p);
      }
      step(t);
    }
    store();
  }

 private:
  static constexpr float kNone = 2;  // no time within an interval

  static std::uint32_t lanes() { return static_cast<std::uint32_t>(hn::Lanes(F())); }
  static HWY_INLINE V at(const float* row, std::uint32_t p) { return hn::Load(F(), row + p); }
  static HWY_INLINE void put(V v, float* row, std::uint32_t p) { hn::Store(v, F(), row + p); }
  static HWY_INLINE V per(V from, V to, float per_us) { return hn::Mul(hn::Sub(to, from), hn::Set(F(), per_us)); }
  static HWY_INLINE V inverse(V v) { return hn::Div(hn::Set(F(), 1.0f), v); }
  float leak(const IntervalTimes& t) const { return static_cast<float>(a_.constants.leak_per_us) * t.h_us; }
  float a_h(const IntervalTimes& t) const { return static_cast<float>(a_.constants.a_per_us) * t.h_us; }

  void load() {
    const auto take = [&](const float* from, float* row, float beyond) {
      std::fill_n(std::copy_n(from + first_, count_, row), vectors_end_ - count_, beyond);
    };
    take(a_.light0, i_[0], 1);
    take(a_.light1, i_[1], 1);
    take(a_.m0, m_[0], 0);
    take(a_.reference, reference_, 0);
    take(a_.blind_us, blind_us_, 0);
    take(a_.threshold_on, on_, 1);
    take(a_.threshold_off, off_, 1);
    if constexpr (kReceptor) {
      take(a_.w, w_[0], 1);
      take(a_.noise, noise_[0], 0);
    } else {
      for (float* row : noise_) std::fill_n(row, kPixels, 0.0f);
    }
    for (std::uint32_t p = 0; p < vectors_end_; p += lanes()) {
      for (int k = 0; k < 2; ++k) follow_light(k, p);
      if constexpr (kReceptor) follow_w(0, p);
    }
    std::fill_n(kept_, kPixels, false);
    std::fill_n(background_s_, kPixels, kNone);
    kept_h_us_ = 0;
    random_of_ = -1;
  }
  void follow_light(int k, std::uint32_t p) {
    const V i = at(i_[k], p);
    put(ln(i), l_[k], p);
    put(inverse(i), g_[k], p);
  }
  void follow_w(int k, std::uint32_t p) {
    const V w = at(w_[k], p);
    put(hn::Neg(ln(w)), v_[k], p);
    put(inverse(w), u_[k], p);
  }
  void store() {
    const auto give = [&](const float* row, float* to) { std::copy_n(row, count_, to + first_); };
    give(i_[0], a_.light0);
    give(i_[1], a_.light1);
    give(m_[0], a_.m0);
    give(reference_, a_.reference);
    give(blind_us_, a_.blind_us);
    if constexpr (kReceptor) {
      give(w_[0], a_.w);
      give(noise_[0], a_.noise);
    }
  }

  // Light of the next frame, where it differs from the one before.
  void take_light(bool first) {
    const F f;
    std::size_t changed = 0;
    const float* now = planes_.next([&](std::uint32_t p, int same) {
      for (float** row : {l_, i_, g_}) put(at(row[1], p), row[2], p);
      moving_[changed] = p;
      changed += same == 0;
    });
    for (std::size_t k = 0; k < changed; ++k) {
      const std::uint32_t p = moving_[k];
      V current;
      const M lit = current_of(a_, hn::LoadU(f, now + p), current);
      put(hn::IfThenElse(lit, current, first ? hn::Set(f, kFloor_fa) : at(i_[1], p)), i_[2], p);
      follow_light(2, p);
    }
  }

  // The first frame, in the newest rows: everything at rest.
  void start() {
    const F f;
    for (std::uint32_t p = 0; p < vectors_end_; p += lanes()) {
      put(hn::Zero(f), m_[0], p);
      put(hn::Zero(f), blind_us_, p);
      put(at(l_[2], p), reference_, p);
      if constexpr (kReceptor) {
        put(at(g_[2], p), w_[0], p);
        follow_w(0, p);
        V noise = hn::Zero(f);
        if (a_.noise_std > 0) noise = hn::Mul(hn::Set(f, a_.noise_std), gaussian(draw(p, 0, Purpose::noise_start)[0]));
        put(noise, noise_[0], p);
        put(hn::Add(at(v_[0], p), noise), reference_, p);
      }
    }
    if (a_.marks)
      for (std::uint32_t p = 0; p < count_; ++p) a_.marks[first_ + p] = {a_.start_us, noise_[0][p]};
  }

  struct Four {
    VU r[4];
    VU operator[](int k) const { return r[k]; }
  };
  // Four steps share one call of Philox.
  Four draw(std::uint32_t p, std::int64_t four, Purpose purpose) const {
    const U32 u;
    const auto s = static_cast<std::uint64_t>(four);
    Four out{{iota(first_ + p), hn::Set(u, static_cast<std::uint32_t>(s)),
              hn::Set(u, static_cast<std::uint32_t>(s >> 32)), hn::Set(u, static_cast<std::uint32_t>(purpose))}};
    philox(out.r, a_.seed);
    return out;
  }
  // Gaussian deviates of a step.
  const float* draws(std::int64_t step) {
    if (step >> 2 != random_of_) {
      random_of_ = step >> 2;
      for (std::uint32_t p = 0; p < vectors_end_; p += lanes()) {
        const Four four = draw(p, random_of_, Purpose::noise);
        for (int k = 0; k < 4; ++k) put(gaussian(four[k]), random_[k], p);
      }
    }
    return random_[step & 3];
  }

  // Vectors in which something moves; in the others the photoreceptor ends as it began.
  void list_moving(const IntervalTimes& t) {
    const F f;
    moving_count_ = 0;
    for (std::uint32_t p = 0; p < vectors_end_; p += lanes()) {
      const std::size_t vector = p / lanes();
      bool still = planes_.same(p) > 2;
      if constexpr (kReceptor) still = still && hn::AllTrue(f, hn::Eq(at(w_[0], p), at(g_[0], p)));
      moving_[moving_count_] = p;
      moving_count_ += !(still && kept_[vector] && kept_h_us_ == t.h_us);
      kept_[vector] = still;
      put(at(m_[0], p), m_[1], p);
      if constexpr (kReceptor) {
        put(at(w_[0], p), w_[1], p);
        put(at(v_[0], p), v_[1], p);
        put(at(u_[0], p), u_[1], p);
      }
    }
    kept_h_us_ = t.h_us;
  }

  // The photoreceptor over the interval, given its light at start, middle and end: two half steps.
  HWY_INLINE void respond(const IntervalTimes& t, std::uint32_t p) {
    const F f;
    const V one = hn::Set(f, 1.0f), zero = hn::Zero(f), h = hn::Set(f, t.h_us);
    const V i0 = at(i_[0], p), i1 = at(i_[1], p), g0 = at(g_[0], p), g1 = at(g_[1], p), w0 = at(w_[0], p);
    const V bow = hn::Mul(hn::Mul(hn::Sub(at(m_[0], p), at(m_[1], p)), h), hn::Set(f, 0.125f));
    const V l0 = at(l_[0], p), lm = hn::MulAdd(hn::Set(f, 0.5f), hn::Add(l0, at(l_[1], p)), bow);
    const V im = hn::Mul(i0, hn::Exp(f, hn::Sub(lm, l0)));  // in still light exactly i0
    const V gm = hn::Div(one, im);
    const V d = hn::Set(f, a_h(t) / 24), im8 = hn::Mul(hn::Set(f, 8.0f), im), five = hn::Set(f, 5.0f);
    const V x0 = hn::Max(zero, hn::Mul(d, hn::Sub(hn::MulAdd(five, i0, im8), i1)));
    const V x1 = hn::Max(zero, hn::Mul(d, hn::Sub(hn::MulAdd(five, i1, im8), i0)));
    V e0, e1;
    const V wm = straight_step(w0, g0, gm, x0, e0), w1 = straight_step(wm, gm, g1, x1, e1);
    put(w1, w_[1], p);
    follow_w(1, p);
    // Noise: an Ornstein-Uhlenbeck process of rate a u. Because dV/dt = a (I - u), its exposure is X - (V1 - V0), so
    // the correlation over the step is e^-X u1/u0.
    const V rho = hn::Min(one, hn::Mul(hn::Mul(e0, e1), hn::Div(w0, w1)));
    put(rho, rho_, p);
    put(hn::Mul(hn::Set(f, a_.noise_std), hn::Sqrt(hn::Mul(hn::Sub(one, rho), hn::Add(one, rho)))), sigma_, p);
  }

  // The interval between the frames of rows 0 and 1, with slopes m_ per us.
  void step(const IntervalTimes& t) {
    const F f;
    if constexpr (kReceptor)
      for (std::size_t k = 0; k < moving_count_; ++k) respond(t, moving_[k]);
    const float* random = kReceptor && a_.noise_std > 0 ? draws(t.step) : nullptr;
    const float* v0_row = kReceptor ? v_[0] : l_[0];
    const float* v1_row = kReceptor ? v_[1] : l_[1];
    const V rate = hn::Set(f, a_h(t)), leaks = hn::Set(f, leak(t)), third = hn::Set(f, 1.0f / 3);
    jobs_count_ = 0;
    for (std::uint32_t p = 0; p < vectors_end_; p += lanes()) {
      const V n0 = at(noise_[0], p), reference = at(reference_, p);
      const V n1 = random ? hn::MulAdd(at(sigma_, p), at(random, p), hn::Mul(at(rho_, p), n0)) : n0;
      put(n1, noise_[1], p);
      const V drift = hn::Add(hn::Sub(n1, n0), leaks);
      const V d0 = hn::Sub(hn::Add(at(v0_row, p), n0), reference);
      const V d1 = hn::Add(hn::Sub(hn::Add(at(v1_row, p), n0), reference), drift);
      V high = hn::Max(d0, d1), low = hn::Min(d0, d1);
      M active = hn::Gt(at(blind_us_, p), hn::Zero(f));
      if constexpr (kReceptor) {
        // V lies within the hull of its Bezier points.
        const V i0 = at(i_[0], p), i1 = at(i_[1], p);
        const V b0 = hn::MulAdd(third, hn::MulAdd(rate, hn::Sub(i0, at(u_[0], p)), drift), d0);
        const V b1 = hn::NegMulAdd(third, hn::MulAdd(rate, hn::Sub(i1, at(u_[1], p)), drift), d1);
        high = hn::Max(high, hn::Max(b0, b1));
        low = hn::Min(low, hn::Min(b0, b1));
        // Fast light needs shorter steps than two.
        const V dl = hn::Sub(at(l_[1], p), at(l_[0], p));
        const V x = hn::Min(hn::Set(f, 1.0f), hn::Mul(hn::Mul(rate, hn::Set(f, 0.5f)), hn::Add(i0, i1)));
        active = hn::Or(active, hn::Gt(hn::Mul(hn::Mul(dl, dl), x), hn::Set(f, 0.02f)));
      }
      active = hn::Or(active, hn::Or(hn::Ge(high, at(on_, p)), hn::Le(low, hn::Neg(at(off_, p)))));
      const Compress compress(hn::And(active, hn::FirstN(f, std::min(lanes(), count_ - p))));
      compress.store(iota(p), jobs_ + jobs_count_);
      jobs_count_ += compress.count();
    }
    take_background(t);
    if (jobs_count_ > 0) find_events(t);
    for (const BackgroundEvent& e : due_) background_s_[e.pixel - first_] = kNone;
    if (a_.constants.leak_per_us > 0)
      for (std::uint32_t p = 0; p < vectors_end_; p += lanes()) put(hn::Sub(at(reference_, p), leaks), reference_, p);
    for (float** row : {m_, w_, v_, u_, noise_}) std::swap(row[0], row[1]);
  }

  // Background events of this interval: each pixel's first into background_s_.
  void take_background(const IntervalTimes& t) {
    std::size_t due = 0;
    while (due < background_.size() && background_[due].t_us < t.t1_us) ++due;
    due_ = background_.first(due);
    background_ = background_.subspan(due);
    for (const BackgroundEvent& e : due_) {
      const std::uint32_t p = e.pixel - first_;
      if (background_s_[p] < kNone) continue;
      background_s_[p] = in_interval(e, t);
      if (std::find(jobs_, jobs_ + jobs_count_, p) == jobs_ + jobs_count_) jobs_[jobs_count_++] = p;
    }
  }
  static float in_interval(const BackgroundEvent& e, const IntervalTimes& t) {
    return std::clamp(static_cast<float>((e.t_us - t.t0_us) / (t.t1_us - t.t0_us)), 0.0f, 0x1.fffffep-1f);
  }

  // A vector of pixels that may fire. Times are s in [0, 1] within the interval, or z within a step of the
  // photoreceptor.
  struct ActiveLanes {
    HWY_ALIGN float live[kLanes], ready[kLanes];  // 1 or 0; ready: for a step
    HWY_ALIGN float on[kLanes], off[kLanes], reference[kLanes], blind[kLanes], n0[kLanes], drift[kLanes],
        background[kLanes];
    HWY_ALIGN float light[4][kLanes], steepest[kLanes], steepest_bend[kLanes];
    HWY_ALIGN float s[kLanes], w[kLanes], i[kLanes], slope[kLanes], v[kLanes];  // the photoreceptor's
    HWY_ALIGN float ds[kLanes], s_next[kLanes], m0[kLanes];                     // of the step to take
    HWY_ALIGN float q[4][kLanes], s0[kLanes], s1[kLanes], z[kLanes];            // of the step taken: V, noise and leak
    HWY_ALIGN float next[kLanes], next_on[kLanes];                              // crossing
    const std::uint32_t* pixels;
    std::size_t count;
    bool any_background;
  };
  static HWY_INLINE V get(const float* row) { return hn::Load(F(), row); }
  static HWY_INLINE void set(float* row, V v) { hn::Store(v, F(), row); }
  static HWY_INLINE M holds(const float* row) { return hn::Gt(get(row), hn::Zero(F())); }
  static HWY_INLINE void set(float* row, M m) { set(row, hn::IfThenElseZero(m, hn::Set(F(), 1.0f))); }
  static HWY_INLINE Cubics cubics(const float (*rows)[kLanes]) {
    return {get(rows[0]), get(rows[1]), get(rows[2]), get(rows[3])};
  }
  static HWY_INLINE void set(float (*rows)[kLanes], const Cubics& c) {
    set(rows[0], c.c0), set(rows[1], c.c1), set(rows[2], c.c2), set(rows[3], c.c3);
  }
  HWY_INLINE Receptors receptors(const IntervalTimes& t, const ActiveLanes& g) const {
    return {cubics(g.light), hn::Set(F(), a_h(t)), get(g.steepest), get(g.steepest_bend), get(g.s), get(g.w),
            get(g.i),        get(g.slope)};
  }

  // The exact work. Every stage goes over all groups: what one waits for, the next fills.
  HWY_NOINLINE void find_events(const IntervalTimes& t) {
    clock_ = Clock(t);
    const std::size_t groups = (jobs_count_ + lanes() - 1) / lanes();
    std::size_t left = 0;
    for (std::size_t k = 0; k < groups; ++k) {
      begin(t, groups_[k], k * lanes());
      at_work_[left++] = &groups_[k];
    }
    while (left > 0) {
      const std::span<ActiveLanes* const> work(at_work_, left);
      if constexpr (kReceptor) {
        for (ActiveLanes* g : work) choose_step(t, *g);
        for (ActiveLanes* g : work) take_step(t, *g);
      }
      for (ActiveLanes* g : work) end_step(t, *g);
      for (ActiveLanes* g : work) find_crossing(*g);
      left = 0;
      for (ActiveLanes* g : work)
        if (fire(t, *g)) at_work_[left++] = g;
    }
    for (std::size_t k = 0; k < groups; ++k) end(t, groups_[k]);
    hand_on();
  }

  void begin(const IntervalTimes& t, ActiveLanes& g, std::size_t job) {
    const F f;
    g.pixels = jobs_ + job;
    g.count = std::min<std::size_t>(lanes(), jobs_count_ - job);
    for (std::size_t k = g.count; k < lanes(); ++k) jobs_[job + k] = jobs_[job];  // not live
    const auto index = hn::BitCast(I32(), hn::LoadU(U32(), g.pixels));
    const auto gather = [&](const float* row) { return hn::GatherIndex(f, row, index); };
    const V one = hn::Set(f, 1.0f), zero = hn::Zero(f), h = hn::Set(f, t.h_us);
    set(g.live, hn::FirstN(f, g.count));
    set(g.ready, hn::FirstN(f, g.count));
    set(g.on, gather(on_));
    set(g.off, gather(off_));
    set(g.reference, gather(reference_));
    set(g.blind, hn::Mul(gather(blind_us_), hn::Set(f, t.per_h)));
    const V n0 = gather(noise_[0]);
    set(g.n0, n0);
    set(g.drift, hn::Add(hn::Sub(gather(noise_[1]), n0), hn::Set(f, leak(t))));
    const V background = gather(background_s_);
    set(g.background, background);
    g.any_background = !hn::AllFalse(f, hn::Lt(background, hn::Set(f, kNone)));
    const Cubics l = hermite(gather(l_[0]), gather(l_[1]), hn::Mul(gather(m_[0]), h), hn::Mul(gather(m_[1]), h));
    set(g.light, l);
    set(g.q, l);
    set(g.s, zero);
    set(g.s0, zero);
    set(g.s1, one);
    set(g.z, zero);
    if constexpr (kReceptor) {
      const V m0 = hn::Abs(l.c1), m1 = hn::Abs(l.slope(one)), dl = hn::Abs(hn::Sub(l.at(one), l.c0));
      set(g.steepest,
          hn::Max(hn::MulAdd(hn::Set(f, 1.5f), dl, hn::Mul(hn::Set(f, 0.25f), hn::Add(m0, m1))), hn::Max(m0, m1)));
      set(g.steepest_bend, hn::Max(hn::Abs(l.bend(zero)), hn::Abs(l.bend(one))));
      set(g.w, gather(w_[0]));
      set(g.i, gather(i_[0]));
      set(g.slope, l.c1);
      set(g.v, gather(v_[0]));
    }
  }

  HWY_INLINE void choose_step(const IntervalTimes& t, ActiveLanes& g) {
    const F f;
    const Receptors r = receptors(t, g);
    const V one = hn::Set(f, 1.0f), rest = hn::Sub(one, r.s);
    const Receptors::Motion motion = r.motion();
    const V steps = hn::Min(hn::Ceil(hn::Div(rest, r.wanted(motion))), hn::Set(f, 1e4f)), ds = hn::Div(rest, steps);
    set(g.ds, ds);
    set(g.s_next, hn::IfThenElse(hn::Le(steps, one), one, hn::Add(r.s, ds)));
    set(g.m0, r.slope_of_v(motion, ds));
  }

  HWY_INLINE void take_step(const IntervalTimes& t, ActiveLanes& g) {
    const F f;
    const Receptors r = receptors(t, g);
    const M ready = holds(g.ready);
    const V one = hn::Set(f, 1.0f), s1 = get(g.s_next), middle = hn::Mul(hn::Set(f, 0.5f), hn::Add(r.s, s1));
    const V i1 = hn::Exp(f, r.light.at(s1)), im = hn::Exp(f, r.light.at(middle)), slope1 = r.light.slope(s1);
    const V x = hn::Mul(hn::Mul(hn::Mul(r.a_h, get(g.ds)), hn::Set(f, 1.0f / 6)),  // Simpson
                        hn::MulAdd(hn::Set(f, 4.0f), im, hn::Add(r.i, i1)));
    const V g0 = hn::Div(one, r.i), g1 = hn::Div(one, i1), per_a_h = hn::Div(one, r.a_h);
    const auto slope_of_g = [&](V l, V v) { return hn::Neg(hn::Mul(hn::Mul(x, l), hn::Mul(hn::Mul(v, v), per_a_h))); };
    const V w1 = receptor_step(r.w, g0, g1, slope_of_g(r.slope, g0), slope_of_g(slope1, g1), x);
    set(g.w, hn::IfThenElse(ready, w1, r.w));
    set(g.i, hn::IfThenElse(ready, i1, r.i));
    set(g.slope, hn::IfThenElse(ready, slope1, r.slope));
  }

  HWY_INLINE void end_step(const IntervalTimes& t, ActiveLanes& g) {
    const F f;
    const M ready = holds(g.ready);
    const V zero = hn::Zero(f), one = hn::Set(f, 1.0f), begin = kReceptor ? get(g.s) : zero;
    const V end = kReceptor ? get(g.s_next) : one;
    Cubics v = cubics(g.light);
    set(g.s, hn::IfThenElse(ready, end, get(g.s)));
    if constexpr (kReceptor) {
      const Receptors r = receptors(t, g);
      const V v1 = hn::IfThenElse(ready, hn::Neg(ln(r.w)), get(g.v));
      v = hermite(get(g.v), v1, get(g.m0), r.slope_of_v(r.motion(), get(g.ds)));
      set(g.v, v1);
    }
    const V drift = get(g.drift);
    v.c0 = hn::Add(v.c0, hn::MulAdd(drift, begin, get(g.n0)));
    v.c1 = hn::MulAdd(drift, hn::Sub(end, begin), v.c1);
    const Cubics q = choose(ready, v, cubics(g.q));
    const V s0 = hn::IfThenElse(ready, begin, get(g.s0)), s1 = hn::IfThenElse(ready, end, get(g.s1));
    V z = hn::IfThenElse(ready, zero, get(g.z));
    const V blind = get(g.blind);
    const M blinded = hn::And(ready, hn::Gt(blind, zero)), sleeps = hn::And(blinded, hn::Ge(blind, s1));
    const M wakes = hn::AndNot(sleeps, blinded);
    if (!hn::AllFalse(f, wakes)) {
      z = hn::IfThenElse(wakes, hn::Max(zero, hn::Div(hn::Sub(blind, s0), hn::Sub(s1, s0))), z);
      set(g.reference, hn::IfThenElse(wakes, q.at(z), get(g.reference)));
      set(g.blind, hn::IfThenZeroElse(wakes, blind));
      mark(t, g, wakes, hn::MulAdd(hn::Sub(s1, s0), z, s0));
    }
    set(g.q, q);
    set(g.s0, s0);
    set(g.s1, s1);
    set(g.z, z);
    set(g.ready, sleeps);
  }

  HWY_INLINE void find_crossing(ActiveLanes& g) {
    const V reference = get(g.reference);
    const FirstCrossing next =
        first_crossing(cubics(g.q), get(g.z), hn::Sub(reference, get(g.off)), hn::Add(reference, get(g.on)));
    set(g.next, next.at);
    set(g.next_on, next.on);
  }

  // The crossings found are events. False when the interval is over for all.
  HWY_INLINE bool fire(const IntervalTimes& t, ActiveLanes& g) {
    const F f;
    const V one = hn::Set(f, 1.0f), zero = hn::Zero(f), s0 = get(g.s0), s1 = get(g.s1), ds = hn::Sub(s1, s0);
    const M seeking = hn::AndNot(holds(g.ready), holds(g.live));
    M by_noise = hn::Lt(one, zero);
    if (g.any_background) by_noise = background_first(t, g, seeking);
    const V at_z = get(g.next);
    const M fires = hn::And(seeking, hn::Le(at_z, one));
    M ready = hn::Or(holds(g.ready), hn::AndNot(fires, seeking));
    if (!hn::AllFalse(f, fires)) {
      const V s = hn::MulAdd(ds, at_z, s0);
      emit(t, g, fires, by_noise, s);
      // The reference is V when the refractory period ends.
      const V refractory = hn::Mul(hn::Set(f, static_cast<float>(a_.constants.refractory_us)), hn::Set(f, t.per_h));
      const V until = hn::Add(s, refractory);
      const M rests = hn::Gt(refractory, zero), sleeps = hn::And(fires, hn::And(rests, hn::Ge(until, s1)));
      const M resets = hn::AndNot(sleeps, fires);
      const V after = hn::IfThenElse(rests, hn::Div(hn::Sub(until, s0), ds), at_z);
      const V z = hn::IfThenElse(resets, after, get(g.z));
      set(g.blind, hn::IfThenElse(sleeps, until, get(g.blind)));
      set(g.reference, hn::IfThenElse(resets, cubics(g.q).at(z), get(g.reference)));
      set(g.z, z);
      ready = hn::Or(ready, sleeps);
      mark(t, g, resets, hn::MulAdd(ds, z, s0));
    }
    const M live = hn::AndNot(hn::And(ready, hn::Ge(get(g.s), one)), holds(g.live));
    set(g.live, live);
    set(g.ready, hn::And(ready, live));
    return !hn::AllFalse(f, live);
  }

  void end(const IntervalTimes& t, ActiveLanes& g) {
    const F f;
    const V blind = get(g.blind), left = hn::Mul(hn::Sub(blind, hn::Set(f, 1.0f)), hn::Set(f, t.h_us));
    set(g.blind, hn::IfThenElseZero(hn::Gt(blind, hn::Zero(f)), hn::Max(left, hn::Set(f, 1e-6f))));
    for (std::size_t k = 0; k < g.count; ++k) {
      const std::uint32_t p = g.pixels[k];
      reference_[p] = g.reference[k];
      blind_us_[p] = g.blind[k];
      if constexpr (kReceptor) {
        w_[1][p] = g.w[k];
        v_[1][p] = g.v[k];
        u_[1][p] = 1 / g.w[k];
      }
    }
  }

  template <class Work>  // for each lane of the mask
  static void each(M which, const Work& work) {
    HWY_ALIGN float flag[kLanes];
    hn::Store(hn::IfThenElseZero(which, hn::Set(F(), 1.0f)), F(), flag);
    for (std::size_t k = 0; k < hn::Lanes(F()); ++k)
      if (flag[k] != 0) work(k);
  }

  // A pixel's noise at s; the drift of the leak is told by the time.
  float noise_at(std::uint32_t p, float s) const { return noise_[0][p] + (noise_[1][p] - noise_[0][p]) * s; }

  void mark(const IntervalTimes& t, const ActiveLanes& g, M which, V s) {
    if (!a_.marks) return;
    HWY_ALIGN float at_s[kLanes];
    hn::Store(s, F(), at_s);
    each(which, [&](std::size_t k) {
      const std::uint32_t p = g.pixels[k];
      a_.marks[first_ + p] = {t.t0_us + double{at_s[k]} * t.h_us, noise_at(p, at_s[k])};
    });
  }

  Cause cause(const IntervalTimes& t, std::uint32_t p, float s, bool on) const {
    const ResetMark& mark = a_.marks[first_ + p];
    const double sign = on ? 1 : -1;
    const double noise = sign * (noise_at(p, s) - mark.noise);
    const double leaked = sign * a_.constants.leak_per_us * (t.t0_us + double{s} * t.h_us - mark.t_us);
    const double signal = (on ? on_[p] : off_[p]) - noise - leaked;
    return signal >= std::max(noise, leaked) ? Cause::signal : leaked > noise ? Cause::leak : Cause::noise;
  }

  HWY_INLINE void emit(const IntervalTimes& t, const ActiveLanes& g, M fires, M by_noise, V s) {
    const U32 u;
    const Compress compress(fires);
    const VU on = hn::IfThenElseZero(hn::RebindMask(u, holds(g.next_on)), hn::Set(u, 1u << kKeyOnShift));
    const VU pixels = hn::Add(hn::LoadU(u, g.pixels), hn::Set(u, first_));
    compress.store(clock_.us(s), us_ + fired_);
    compress.store(hn::Or(hn::ShiftLeft<kKeyPixelShift>(pixels), on), place_ + fired_);
    if (a_.marks) {
      HWY_ALIGN float at_s[kLanes], noise[kLanes];
      set(at_s, s);
      set(noise, by_noise);
      std::uint32_t* place = place_ + fired_;
      each(fires, [&](std::size_t k) {
        const std::uint32_t p = g.pixels[k];
        const Cause why = noise[k] > 0 ? background_cause_[p] : cause(t, p, at_s[k], g.next_on[k] > 0);
        *place++ |= static_cast<std::uint32_t>(why);
      });
    }
    fired_ += compress.count();
    if (fired_ > kRoom) hand_on();
  }
  void hand_on() {
    clock_.add(us_, place_, fired_, *a_.events);
    fired_ = 0;
  }

  // Where a background event comes before the crossing found, it takes its place. Those that were before are over.
  M background_first(const IntervalTimes& t, ActiveLanes& g, M seeking) {
    const F f;
    HWY_ALIGN float noise[kLanes] = {};
    const BackgroundEvent* const none = due_.data() + due_.size();
    each(seeking, [&](std::size_t k) {
      if (g.background[k] >= kNone) return;
      const std::uint32_t p = g.pixels[k];
      const auto after = [&](const BackgroundEvent* e, float s) {  // the first at s or later
        while (e != none && (e->pixel != first_ + p || in_interval(*e, t) < s)) ++e;
        return e;
      };
      const auto time_of = [&](const BackgroundEvent* e) { return e == none ? kNone : in_interval(*e, t); };
      const float length = g.s1[k] - g.s0[k], now = g.s0[k] + length * g.z[k];
      const BackgroundEvent* e = after(due_.data(), std::max(g.background[k], now));
      g.background[k] = time_of(e);
      const float z = (g.background[k] - g.s0[k]) / length;
      if (g.background[k] >= g.s1[k] || z >= g.next[k]) return;
      g.next[k] = std::max(z, 0.0f);
      g.next_on[k] = e->on;
      noise[k] = 1;
      background_cause_[p] = e->cause;
      g.background[k] = time_of(after(e + 1, 0));
    });
    return hn::Gt(hn::Load(f, noise), hn::Zero(f));
  }

  const KernelArguments& a_;
  Planes<kPixels> planes_;
  std::uint32_t first_ = 0, count_ = 0, vectors_end_ = 0;
  std::span<const BackgroundEvent> background_, due_;  // to come; of this interval
  std::int64_t random_of_ = -1;
  float kept_h_us_ = 0;
  std::size_t moving_count_ = 0, jobs_count_ = 0;

  // Rows of a value per pixel. Of frames: the interval's start and end and the frame after it; of the rest: start, end.
  static constexpr std::size_t kRows = 9 + 10;
  HWY_ALIGN float rows_[kRows][kPixels];
  float* l_[3] = {rows_[0], rows_[1], rows_[2]};  // ln I
  float* i_[3] = {rows_[3], rows_[4], rows_[5]};  // photo- plus dark current I [fA]
  float* g_[3] = {rows_[6], rows_[7], rows_[8]};  // 1/I
  float* m_[2] = {rows_[9], rows_[10]};           // slope of ln I [1/us]
  float* w_[2] = {rows_[11], rows_[12]};          // photoreceptor: 1/u
  float* v_[2] = {rows_[13], rows_[14]};          // ln u
  float* u_[2] = {rows_[15], rows_[16]};
  float* noise_[2] = {rows_[17], rows_[18]};
  HWY_ALIGN float reference_[kPixels], blind_us_[kPixels], on_[kPixels], off_[kPixels], rho_[kPixels], sigma_[kPixels],
      background_s_[kPixels], random_[4][kPixels];
  bool kept_[kPixels];  // of a vector: rho_ and sigma_ are of this light
  Cause background_cause_[kPixels];
  std::uint32_t moving_[kPixels + 1], jobs_[kPixels + 2 * kLanes];
  Clock clock_;            // of the interval
  std::size_t fired_ = 0;  // events to hand on
  std::int32_t us_[kRoom + 2 * kLanes];
  std::uint32_t place_[kRoom + 2 * kLanes];
  ActiveLanes groups_[kPixels / kLanes + 1];
  ActiveLanes* at_work_[kPixels / kLanes + 1];
};

template <bool kReceptor>
void run_all(const KernelArguments& a) {
  using Block = PixelBlock<kReceptor>;
  const auto block = std::make_unique<Block>(a);
  const std::uint32_t end = a.first + a.count;
  auto background = a.background;
  std::vector<BackgroundEvent> by_time;
  for (std::uint32_t first = a.first; first < end; first += Block::kPixels) {
    const std::uint32_t block_end = std::min(end, first + Block::kPixels);
    const auto mine = std::ranges::lower_bound(background, block_end, {}, &BackgroundEvent::pixel);
    by_time.assign(background.begin(), mine);
    background = {mine, background.end()};
    std::ranges::stable_sort(by_time, {}, &BackgroundEvent::t_us);
    block->run(first, block_end, by_time);
  }
}

void RunKernel(const KernelArguments& a) {
  if (a.constants.a_per_us > 0)
    run_all<true>(a);
  else
    run_all<false>(a);
}

}  // namespace pecs::sensor::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace pecs::sensor {
HWY_EXPORT(RunKernel);
void run_kernel(const KernelArguments& arguments) { HWY_DYNAMIC_DISPATCH(RunKernel)(arguments); }
}  // namespace pecs::sensor
#endif
