// The charge-type (logistic) photoreceptor (docs/reference/sensor.md): du/dt = a u (I - u), V = ln u, with a = 2 pi *
// corner per ampere. A node charged by the photocurrent I and discharged by a current u that is exponential in V: its
// corner, a I / 2 pi, follows the light, and it answers darkening more slowly than brightening.
//
// In w = 1/u it is linear: dw/dx = 1/I - w, with dx = a I dt. So over a step of exposure x
//   w1 = e^-x w0 + integral over [0, x] of e^-(x-y) g(y) dy,  g = 1/I,
// and with g a polynomial the integral has a closed form: exact for constant light, and stable for any x.
//
// Included once per instruction set.
#if defined(PECS_PHOTORECEPTOR_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef PECS_PHOTORECEPTOR_INL_H_
#undef PECS_PHOTORECEPTOR_INL_H_
#else
#define PECS_PHOTORECEPTOR_INL_H_
#endif

#include <hwy/contrib/math/math-inl.h>

#include "models/pecs/cubic-inl.h"

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

  // What the choice of steps needs of the light: no slope and no second derivative in the interval is greater.
  void bound() {
    const V zero = hn::Zero(F()), one = hn::Set(F(), 1.0f);
    const V m0 = hn::Abs(light.c1), m1 = hn::Abs(light.slope(one)), dl = hn::Abs(hn::Sub(light.at(one), light.c0));
    steepest =
        hn::Max(hn::MulAdd(hn::Set(F(), 1.5f), dl, hn::Mul(hn::Set(F(), 0.25f), hn::Add(m0, m1))), hn::Max(m0, m1));
    steepest_bend = hn::Max(hn::Abs(light.bend(zero)), hn::Abs(light.bend(one)));
  }
  // The next step: its length, where it ends, dV/ds times its length at its start.
  struct Step {
    V ds, end, slope_of_v;
  };
  Step choose() const {
    const F f;
    const V one = hn::Set(f, 1.0f), rest = hn::Sub(one, s);
    const Motion now = motion();
    const V steps = hn::Min(hn::Ceil(hn::Div(rest, wanted(now))), hn::Set(f, 1e4f)), ds = hn::Div(rest, steps);
    return {ds, hn::IfThenElse(hn::Le(steps, one), one, hn::Add(s, ds)), slope_of_v(now, ds)};
  }
  // w, I and its slope at the end of the step, where `ready`; s is the caller's.
  void take(M ready, V ds, V end) {
    const F f;
    const V one = hn::Set(f, 1.0f), middle = hn::Mul(hn::Set(f, 0.5f), hn::Add(s, end));
    const V i1 = hn::Exp(f, light.at(end)), im = hn::Exp(f, light.at(middle)), slope1 = light.slope(end);
    const V x = hn::Mul(hn::Mul(hn::Mul(a_h, ds), hn::Set(f, 1.0f / 6)),  // Simpson
                        hn::MulAdd(hn::Set(f, 4.0f), im, hn::Add(i, i1)));
    const V g0 = hn::Div(one, i), g1 = hn::Div(one, i1), per_a_h = hn::Div(one, a_h);
    const auto slope_of_g = [&](V l, V v) { return hn::Neg(hn::Mul(hn::Mul(x, l), hn::Mul(hn::Mul(v, v), per_a_h))); };
    const V w1 = receptor_step(w, g0, g1, slope_of_g(slope, g0), slope_of_g(slope1, g1), x);
    w = hn::IfThenElse(ready, w1, w);
    i = hn::IfThenElse(ready, i1, i);
    slope = hn::IfThenElse(ready, slope1, slope);
  }
};

// Light of an interval at its start and end: ln I, its slopes [1/us], I [fA], 1/I.
struct IntervalLight {
  V l0, l1, m0, m1, i0, i1, g0, g1;
};
struct Response {
  V w, correlation;  // at the end; of the noise, from start to end
};

// The photoreceptor over an interval, given its light at start, middle and end: two half steps.
HWY_INLINE Response two_half_steps(const IntervalLight& light, V w0, float h_us, float a_h) {
  const F f;
  const V one = hn::Set(f, 1.0f), zero = hn::Zero(f), h = hn::Set(f, h_us);
  const auto& [l0, l1, m0, m1, i0, i1, g0, g1] = light;
  const V bow = hn::Mul(hn::Mul(hn::Sub(m0, m1), h), hn::Set(f, 0.125f));
  const V lm = hn::MulAdd(hn::Set(f, 0.5f), hn::Add(l0, l1), bow);
  const V im = hn::Mul(i0, hn::Exp(f, hn::Sub(lm, l0)));  // in still light exactly i0
  const V gm = hn::Div(one, im);
  const V d = hn::Set(f, a_h / 24), im8 = hn::Mul(hn::Set(f, 8.0f), im), five = hn::Set(f, 5.0f);
  const V x0 = hn::Max(zero, hn::Mul(d, hn::Sub(hn::MulAdd(five, i0, im8), i1)));
  const V x1 = hn::Max(zero, hn::Mul(d, hn::Sub(hn::MulAdd(five, i1, im8), i0)));
  V e0, e1;
  const V wm = straight_step(w0, g0, gm, x0, e0), w1 = straight_step(wm, gm, g1, x1, e1);
  // Noise: an Ornstein-Uhlenbeck process of rate a u. Because dV/dt = a (I - u), its exposure is X - (V1 - V0), so
  // the correlation over the step is e^-X u1/u0.
  return {w1, hn::Min(one, hn::Mul(hn::Mul(e0, e1), hn::Div(w0, w1)))};
}
// The same in light I that stays, bit by bit: what is 0 or 1 there is left out. g: 1/I.
HWY_INLINE Response still_half_steps(V i, V g, V w0, float a_h) {
  const F f;
  const V one = hn::Set(f, 1.0f), i8 = hn::Mul(hn::Set(f, 8.0f), i);
  const V x = hn::Max(hn::Zero(f), hn::Mul(hn::Set(f, a_h / 24), hn::Sub(hn::MulAdd(hn::Set(f, 5.0f), i, i8), i)));
  const V e = hn::NegMulAdd(x, phi1(x), one);
  const V wm = hn::MulAdd(e, hn::Sub(w0, g), g), w1 = hn::MulAdd(e, hn::Sub(wm, g), g);
  return {w1, hn::Min(one, hn::Mul(hn::Mul(e, e), hn::Div(w0, w1)))};
}
// Of what is new in the noise at the end.
HWY_INLINE V noise_deviation(float noise_std, V correlation) {
  const V one = hn::Set(F(), 1.0f);
  return hn::Mul(hn::Set(F(), noise_std), hn::Sqrt(hn::Mul(hn::Sub(one, correlation), hn::Add(one, correlation))));
}

// Bounds of V over an interval, V lying within the hull of its Bezier points. d0, d1: V at the ends, with the drift of
// noise and leak; rate: a h; excess0, excess1: I - u there.
HWY_INLINE void widen_to_hull(V d0, V d1, V rate, V excess0, V excess1, V drift, V& low, V& high) {
  const V third = hn::Set(F(), 1.0f / 3);
  const V b0 = hn::MulAdd(third, hn::MulAdd(rate, excess0, drift), d0);
  const V b1 = hn::NegMulAdd(third, hn::MulAdd(rate, excess1, drift), d1);
  high = hn::Max(high, hn::Max(b0, b1));
  low = hn::Min(low, hn::Min(b0, b1));
}

}  // namespace pecs::sensor::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif
