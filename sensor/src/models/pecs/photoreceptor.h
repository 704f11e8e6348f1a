// The charge-type (logistic) photoreceptor (docs/reference/sensor.md): du/dt = a u (I - u), V = ln u, with a = 2 pi *
// corner per ampere. A node is charged by the photocurrent I and discharged by a current u that is exponential in V:
// its corner frequency, a I / 2 pi, follows the light, and it responds more slowly to darkening than to brightening.
//
// In w = 1/u it is linear: dw/dx = 1/I - w, with dx = a I dt. So over a step of exposure x
//   w1 = e^-x w0 + integral over [0, x] of e^-(x-y) g(y) dy,  g = 1/I,
// and with g a polynomial the integral has a closed form: exact for constant light, and stable for any x.
//
// Templates over a number type (number.h). The truncated series are accurate to 3e-7, enough for float.
#if defined(PECS_PHOTORECEPTOR_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef PECS_PHOTORECEPTOR_H_
#undef PECS_PHOTORECEPTOR_H_
#else
#define PECS_PHOTORECEPTOR_H_
#endif

#include "models/pecs/cubic.h"

PECS_BEGIN_NUMBERS

// (1 - e^-x) / x for x >= 0.
template <class T>
PECS_INLINE T phi1(T x) {
  T series = number<T>(1.0 / 5040);
  for (const double c : {-1.0 / 720, 1.0 / 120, -1.0 / 24, 1.0 / 6, -0.5, 1.0})
    series = mul_add(series, x, number<T>(c));
  const auto small = x < 0.5f;
  if (all(small)) return series;
  return select(small, series, (1.0f - exp(-x)) / x);
}

// w after exposure x. g: the cubic from g0 to g1 that has slopes d0 and d1 per step at its ends.
template <class T>
PECS_INLINE T receptor_step(T w, T g0, T g1, T d0, T d1, T x) {
  const T one = number<T>(1);
  // j_n: integral of e^-(x-y) (y/x)^n. j_n = 1 - n j_(n-1) / x; up from e^-x, or down from the series of j_3.
  const auto large = x > one;
  T j0, j1, j2, j3;
  if (!all(large)) {
    T series = number<T>(-6.0 / 39916800);
    for (const double c : {6.0 / 3628800, -6.0 / 362880, 6.0 / 40320, -6.0 / 5040, 6.0 / 720, -6.0 / 120, 6.0 / 24})
      series = mul_add(series, x, number<T>(c));
    j3 = x * series;
    j2 = x * number<T>(1.0 / 3) * (one - j3);
    j1 = x * number<T>(0.5) * (one - j2);
    j0 = x * (one - j1);
  }
  if (any(large)) {
    const T per_x = one / x;
    j0 = select(large, one - exp(-x), j0);
    j1 = select(large, neg_mul_add(per_x, j0, one), j1);
    j2 = select(large, neg_mul_add(per_x + per_x, j1, one), j2);
    j3 = select(large, neg_mul_add(3.0f * per_x, j2, one), j3);
  }
  const T rise = g1 - g0, both = d0 + d1;
  const T c2 = 3.0f * rise - (d0 + both), c3 = both - (rise + rise);
  return mul_add(c3, j3, mul_add(c2, j2, mul_add(d0, j1, mul_add(j0, g0 - w, w))));
}

// w after exposure x, with g linear from g0 to g1.
template <class T>
PECS_INLINE T linear_step(T w, T g0, T g1, T x) {
  const T one = number<T>(1), phi = phi1(x), e = neg_mul_add(x, phi, one);
  return mul_add(g1 - g0, one - phi, mul_add(e, w - g0, g0));
}

// The photoreceptor within an interval, in adaptive steps: one in constant light, more during relaxation. The error of
// V is about `tolerance`.
template <class T>
struct Photoreceptor {
  Cubic<T> light;  // ln I
  float tolerance;
  T a_h, steepest, steepest_second;
  T s, w, i, slope;

  // (dV/ds) / (a_h I) = 1 - u / I, in two parts: V's motion with the light, and its relaxation towards that. In fast
  // light dV/ds = l' + (l'^2 - l'') / (a_h I) to second order in 1 / (a_h I).
  struct Motion {
    T follows, relaxes;
  };
  Motion motion() const {
    const T x = a_h * i, per_x = 1.0f / x;
    const T second = mul_sub(slope, slope, light.second_derivative(s)) * (per_x * per_x);
    const T follows = mul_add(slope, per_x, select_or_zero(x > steepest + steepest, second));
    return {follows, 1.0f - 1.0f / (w * i) - follows};
  }
  // dV/ds times ds; a relaxation that ends within the step counts as one of three time constants.
  T slope_of_v(const Motion& m, T ds) const {
    const T x = a_h * i * ds;
    return mul_add(x, m.follows, min(x, number<T>(3)) * m.relaxes);
  }
  // Length of the next step. The error of a cubic through a relaxation of amplitude r is r (ds / time constant)^4 /
  // 384; r: the present relaxation and, in slow light, the one that the light's second derivative adds in the step.
  T step_length(const Motion& m) const {
    const T one = number<T>(1);
    const T x = a_h * max(i, one / w), x_1 = one + x;
    const T r = abs(m.relaxes) + select_or_zero(x <= steepest + steepest, steepest_second / (x_1 * x_1));
    const T relaxation = sqrt(sqrt(384 * tolerance / r)) / x;
    const T slow = 0.5f / steepest;
    return min(min(one, slow), select(r < tolerance, one, relaxation));
  }

  // Upper bounds of the light's slope and second derivative in the interval.
  void bound() {
    const T zero = number<T>(0), one = number<T>(1);
    const T m0 = abs(light.c1), m1 = abs(light.slope(one)), dl = abs(light.at(one) - light.c0);
    steepest = max(mul_add(number<T>(1.5), dl, 0.25f * (m0 + m1)), max(m0, m1));
    steepest_second = max(abs(light.second_derivative(zero)), abs(light.second_derivative(one)));
  }
  // The next step, at most `longest` and until `last`: its length, its end, and dV/ds times its length at its start.
  struct Step {
    T ds, end, slope_of_v;
  };
  Step choose(const Motion& now, T longest, T last = number<T>(1)) const {
    const T one = number<T>(1), rest = last - s;
    const T steps = min(ceil(rest / min(step_length(now), longest)), number<T>(1e4)), ds = rest / steps;
    return {ds, select(steps <= one, last, s + ds), slope_of_v(now, ds)};
  }
  // Advances w, i and slope to the end of the step where `ready`; the caller advances s.
  // Returns the step's exposure, the integral of a I.
  T take(MaskOf<T> ready, T ds, T end) {
    const T middle = 0.5f * (s + end);
    const T i1 = exp(light.at(end)), im = exp(light.at(middle)), slope1 = light.slope(end);
    const T x = a_h * ds * number<T>(1.0 / 6) * mul_add(number<T>(4), im, i + i1);  // Simpson
    const T g0 = 1.0f / i, g1 = 1.0f / i1, per_a_h = 1.0f / a_h;
    const auto slope_of_g = [&](T l, T g) { return -(x * l * (g * g * per_a_h)); };
    const T w1 = receptor_step(w, g0, g1, slope_of_g(slope, g0), slope_of_g(slope1, g1), x);
    w = select(ready, w1, w);
    i = select(ready, i1, i);
    slope = select(ready, slope1, slope);
    return x;
  }
};

// Light of an interval at its start and end: ln I, its slopes [1/us], I [fA], 1/I.
template <class T>
struct IntervalLight {
  T l0, l1, m0, m1, i0, i1, g0, g1;
};
template <class T>
struct Response {
  T w;         // at the end
  T exposure;  // integral of a I
};

// The photoreceptor over an interval, given its light at start, middle and end: two half steps.
template <class T>
PECS_INLINE Response<T> two_half_steps(const IntervalLight<T>& light, T w0, float h_us, float a_h) {
  const T zero = number<T>(0);
  const auto& [l0, l1, m0, m1, i0, i1, g0, g1] = light;
  const T bow = (m0 - m1) * number<T>(h_us) * number<T>(0.125);
  const T lm = mul_add(number<T>(0.5), l0 + l1, bow);
  const T im = i0 * exp(lm - l0);  // in constant light exactly i0
  const T gm = 1.0f / im;
  const T d = number<T>(a_h / 24), im8 = 8.0f * im, five = number<T>(5);
  const T x0 = max(zero, d * (mul_add(five, i0, im8) - i1));
  const T x1 = max(zero, d * (mul_add(five, i1, im8) - i0));
  const T wm = linear_step(w0, g0, gm, x0), w1 = linear_step(wm, gm, g1, x1);
  return {w1, x0 + x1};
}
// Constant light i = 1/g: bit-identical to two_half_steps, with the terms that vanish left out.
template <class T>
PECS_INLINE Response<T> constant_half_steps(T i, T g, T w0, float a_h) {
  const T one = number<T>(1), i8 = 8.0f * i;
  const T x = max(number<T>(0), number<T>(a_h / 24) * (mul_add(number<T>(5), i, i8) - i));
  const T e = neg_mul_add(x, phi1(x), one);
  const T wm = mul_add(e, w0 - g, g), w1 = mul_add(e, wm - g, g);
  return {w1, x + x};
}

// Integral of a u over a time, the relaxation of its noise: dV/dt = a (I - u). exposure: integral of a I; a_h: a times
// the time. In dim light V's change is lost in its rounding.
template <class T>
PECS_INLINE T relaxation_of(T exposure, T v0, T v1, T u0, T u1, T a_h) {
  return select(exposure < 0.1f, 0.5f * a_h * (u0 + u1), max(exposure - (v1 - v0), 0.01f * exposure));
}

// Widens the bounds of V to the convex hull of its Bezier points. d0, d1: V at the ends, with the drift of noise and
// leak; rate: a h; excess0, excess1: I - u there.
template <class T>
PECS_INLINE void widen_to_hull(T d0, T d1, T rate, T excess0, T excess1, T drift, T& low, T& high) {
  const T third = number<T>(1.0 / 3);
  const T b0 = mul_add(third, mul_add(rate, excess0, drift), d0);
  const T b1 = neg_mul_add(third, mul_add(rate, excess1, drift), d1);
  high = max(high, max(b0, b1));
  low = min(low, min(b0, b1));
}

PECS_END_NUMBERS
#endif
