// Cubics between frames, and where a cubic crosses a level. Templates over a number type (number.h).
#if defined(PECS_CUBIC_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef PECS_CUBIC_H_
#undef PECS_CUBIC_H_
#else
#define PECS_CUBIC_H_
#endif

#include "models/pecs/interval.h"
#include "models/pecs/number.h"

PECS_BEGIN_NUMBERS

// Slope at a frame between two intervals, from their chords s0 and s1 and the slope m0 at the first one's start:
// between those of the parabola through both frames before it with m0 and of the parabola through all three frames. As
// with a spline, the mean speed hardly depends on where in an interval it is taken. Limits as in Huynh's M4 (SIAM J.
// Numer. Anal. 30, 1993): a cubic goes beyond its frames only where both parabolas bend alike, or by kFreeOvershoot. 0
// next to still light.
template <class T>
PECS_INLINE T inner_slope(T s0, T s1, T m0, const SlopeWeights& w) {
  const T before = s0 - m0, around = number<T>(w.share) * (s1 - s0);  // half of the curvatures, times this interval
  const T slope = mul_add(number<T>(w.blend), around - before, s0 + before);
  const T product = s0 * s1;
  const T monotone = select_or_zero(product > 0.0f, 3.0f * min(abs(s0), abs(s1)));
  const T smooth = select_or_zero(before * around > 0.0f, number<T>(w.bend) * min(abs(before), abs(around)));
  const T limit = max(max(monotone, smooth), number<T>(w.free_slope));
  const T limited = max(min(slope, limit), -limit);
  return select_or_zero(product < 0.0f || (product > 0.0f && limited * s0 > 0.0f), limited);
}

// Slope at the first or last frame: the parabola's, kept monotone. s0, h0: the interval that ends here.
template <class T>
PECS_INLINE T end_slope(T s0, T s1, float h0, float h1) {
  const T slope = number<T>(1 / (h0 + h1)) * (number<T>(2 * h0 + h1) * s0 - number<T>(h0) * s1);
  const T limit = 3.0f * s0;
  const T limited = select(s0 * s1 < 0.0f && abs(slope) > abs(limit), limit, slope);
  return select_or_zero(limited * s0 > 0.0f, limited);
}

// c0 + c1 s + c2 s^2 + c3 s^3.
template <class T>
struct Cubic {
  T c0, c1, c2, c3;
  T at(T s) const { return mul_add(mul_add(mul_add(c3, s, c2), s, c1), s, c0); }
  T slope(T s) const { return mul_add(mul_add(3.0f * c3, s, c2 + c2), s, c1); }
  T second_derivative(T s) const { return mul_add(6.0f * c3, s, c2 + c2); }
};

template <class T>
PECS_INLINE Cubic<T> operator+(const Cubic<T>& a, const Cubic<T>& b) {
  return {a.c0 + b.c0, a.c1 + b.c1, a.c2 + b.c2, a.c3 + b.c3};
}

// By values and slopes at 0 and 1.
template <class T>
PECS_INLINE Cubic<T> hermite(T v0, T v1, T m0, T m1) {
  const T rise = v1 - v0, both = m0 + m1;
  return {v0, m0, 3.0f * rise - (m0 + both), both - (rise + rise)};
}
template <class T>
PECS_INLINE Cubic<T> select(MaskOf<T> which, const Cubic<T>& yes, const Cubic<T>& no) {
  return {select(which, yes.c0, no.c0), select(which, yes.c1, no.c1), select(which, yes.c2, no.c2),
          select(which, yes.c3, no.c3)};
}

// Solves c1 s + c2 s^2 + c3 s^3 = level, rising from a to b: Halley's method, kept in the bracket. Convergence is of
// third order, so a step below 3e-3 is the last. Just before an extremum, where it is slower, the error of V can reach
// 2e-3.
template <class T>
struct Halley {
  T s, level, c1, c2, c3, a, b;
  MaskOf<T> done;

  PECS_INLINE Halley() = default;
  PECS_INLINE Halley(T guess, T level_now, T c1_now, T c2_now, T c3_now, T from, T to)
      : s(min(max(guess, from), to)),
        level(level_now),
        c1(c1_now),
        c2(c2_now),
        c3(c3_now),
        a(from),
        b(to),
        done(to < from) {}
  PECS_INLINE void step() {
    const T off = mul_add(mul_add(c3, s, c2), s, c1) * s - level;
    const T c3_3 = 3.0f * c3, half_second = mul_add(c3_3, s, c2);
    const T slope = mul_add(mul_add(c3_3, s, c2 + c2), s, c1);
    const auto below = off < 0.0f;
    a = select(below, s, a);
    b = select(below, b, s);
    const T halley = s - off * slope / neg_mul_add(off, half_second, slope * slope);
    const auto inside = halley >= a && halley <= b;
    const T middle = 0.5f * (a + b);
    const T next = select(done, s, select(inside, halley, middle));
    done = done || (inside && abs(next - s) < 3e-3f);
    s = next;
  }
};

// Ends of a cubic's monotone pieces in [from, 1]: from <= first <= second <= 1. A piece that it lacks is empty.
template <class T>
struct Turns {
  T first, second;
};
template <class T>
PECS_INLINE Turns<T> turns(const Cubic<T>& q, T from) {
  // 3 c3 s^2 + 2 c2 s + c1 = 0.
  const T root2 = neg_mul_add(3.0f * q.c3, q.c1, q.c2 * q.c2);
  const T sum = -(q.c2 + copy_sign(sqrt(root2), q.c2));
  const T r0 = sum / (3.0f * q.c3), r1 = q.c1 / sum;
  const auto swap = r0 > r1;
  const T first = select(swap, r1, r0), second = select(swap, r0, r1);
  const auto inside = [&](T s, T after) { return s > after && s < number<T>(1); };  // false for NaN
  const T e0 = select(inside(first, from), first, from);
  return {e0, select(inside(second, e0), second, e0)};
}

template <class T>
struct Crossing {
  T at;  // > 1: none
  MaskOf<T> on;
};

// The first s >= from where a cubic is >= high (on) or <= low.
template <class T>
PECS_INLINE Crossing<T> first_crossing(const Cubic<T>& q, T from, T low, T high) {
  const T one = number<T>(1);
  const auto [e0, e1] = turns(q, from);
  const T q_from = q.at(from), q0 = q.at(e0), q1 = q.at(e1), q2 = q.at(one);
  const auto outside = [&](T v) { return v >= high || v <= low; };
  const auto at_once = outside(q_from), in0 = outside(q0), in1 = outside(q1), in2 = outside(q2);

  // The first piece that leaves [low, high], and the values at its ends.
  const T a = select(in0, from, select(in1, e0, e1));
  const T b = select(in0, e0, select(in1, e1, one));
  const T qa = select(in0, q_from, select(in1, q0, q1));
  const T qb = select(at_once, q_from, select(in0, q0, select(in1, q1, q2)));
  const auto found = (at_once || in0) || (in1 || in2), on = qb >= high;
  const T level = select(on, high, low), up = select(on, one, -one);
  const T guess = mul_add(b - a, (level - qa) / (qb - qa), a);
  Halley<T> solve(guess, up * (level - q.c0), up * q.c1, up * q.c2, up * q.c3, a, b);
  solve.done = at_once || !found;
  for (int n = 0; n < 12 && !all(solve.done); ++n) solve.step();
  return {select(at_once, from, select(found, solve.s, number<T>(2))), on};
}

PECS_END_NUMBERS
#endif
