// Monotone cubics between frames (Fritsch & Butland, SIAM J. Sci. Stat. Comput. 5, 1984), and where cubics cross a
// level. Included once per instruction set.
#if defined(PECS_CUBIC_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef PECS_CUBIC_INL_H_
#undef PECS_CUBIC_INL_H_
#else
#define PECS_CUBIC_INL_H_
#endif

#include "models/pecs/math-inl.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::sensor::HWY_NAMESPACE {

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

// Where c1 s + c2 s^2 + c3 s^3, rising from a to b, is `level`: Halley's steps, kept in the bracket. A lane stops by
// itself when a step was so short that the next would be nothing.
struct Halley {
  V s, level, c1, c2, c3, a, b;
  M done;

  HWY_INLINE Halley() = default;
  HWY_INLINE Halley(V guess, V level_now, V c1_now, V c2_now, V c3_now, V from, V to)
      : s(hn::Min(hn::Max(guess, from), to)),
        level(level_now),
        c1(c1_now),
        c2(c2_now),
        c3(c3_now),
        a(from),
        b(to),
        done(hn::Lt(to, from)) {}
  HWY_INLINE void step() {
    const F f;
    const V off = hn::Sub(hn::Mul(hn::MulAdd(hn::MulAdd(c3, s, c2), s, c1), s), level);
    const V c3_3 = hn::Mul(hn::Set(f, 3.0f), c3), half_bend = hn::MulAdd(c3_3, s, c2);
    const V slope = hn::MulAdd(hn::MulAdd(c3_3, s, hn::Add(c2, c2)), s, c1);
    const M below = hn::Lt(off, hn::Zero(f));
    a = hn::IfThenElse(below, s, a);
    b = hn::IfThenElse(below, b, s);
    const V halley = hn::Sub(s, hn::Div(hn::Mul(off, slope), hn::NegMulAdd(off, half_bend, hn::Mul(slope, slope))));
    const M inside = hn::And(hn::Ge(halley, a), hn::Le(halley, b));
    const V middle = hn::Mul(hn::Set(f, 0.5f), hn::Add(a, b));
    const V next = hn::IfThenElse(done, s, hn::IfThenElse(inside, halley, middle));
    done = hn::Or(done, hn::And(inside, hn::Lt(hn::Abs(hn::Sub(next, s)), hn::Set(f, 3e-3f))));
    s = next;
  }
};

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

}  // namespace pecs::sensor::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif
