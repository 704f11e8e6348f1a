// The stage behind the photoreceptor, a source follower or difference amplifier (docs/reference/sensor.md): one pole
// whose corner is the same in all light: dy/dt = b (V - y), b = 2 pi amplifier_cutoff_hz. The comparators see y.
//
// While V is a cubic, y has a closed form: that of receptor_step, with the exposure b dt.
//
// Templates over a number type (number.h).
#if defined(PECS_AMPLIFIER_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef PECS_AMPLIFIER_H_
#undef PECS_AMPLIFIER_H_
#else
#define PECS_AMPLIFIER_H_
#endif

#include "models/pecs/photoreceptor.h"

PECS_BEGIN_NUMBERS

// y at the end of an interval, from its start: constants of one interval and of all pixels.
template <class T>
PECS_INLINE AmplifierWeights amplifier_weights(T x) {
  const T zero = number<T>(0), one = number<T>(1);
  const auto weight = [&](T v0, T v1, T d0, T d1) {
    return static_cast<float>(receptor_step(zero, v0, v1, d0, d1, x));
  };
  return {static_cast<float>(x),         static_cast<float>(exp(-x)),   weight(one, zero, zero, zero),
          weight(zero, one, zero, zero), weight(zero, zero, one, zero), weight(zero, zero, zero, one)};
}

// V's slope at one end of an interval for a cubic over all of it: a relaxation that ends early counts as one of three
// time constants.
template <class T>
struct WholeSlope {
  T slope;  // per interval
  T early;  // of that relaxation: the cubic's integral, less the true one
};
// light_slope: of ln I, per interval; a_h: exposure of the photoreceptor at the light 1; i = 1/g.
template <class T>
PECS_INLINE WholeSlope<T> whole_slope(T light_slope, float a_h, T i, T g, T u) {
  const T per_x = number<T>(1 / a_h) * g, relaxes = neg_mul_add(u, g, number<T>(1)) - light_slope * per_x;
  const T slope = mul_add(min(number<T>(a_h) * i, number<T>(3)), relaxes, light_slope);
  return {slope, relaxes * max(number<T>(0), 0.25f - per_x)};
}

// The amplifier over an interval.
template <class T>
PECS_INLINE T amplified(T y, T v0, T v1, const WholeSlope<T>& at0, const WholeSlope<T>& at1,
                        const AmplifierWeights& k) {
  const T ends = mul_add(number<T>(k.v1), v1 - y, mul_add(number<T>(k.v0), v0 - y, y));
  const T slopes = mul_add(number<T>(k.d1), at1.slope, mul_add(number<T>(k.d0), at0.slope, ends));
  return mul_add(number<T>(k.x * k.decay), at0.early, slopes);
}

// Within an interval, along with the steps of the photoreceptor.
template <class T>
struct Amplifier {
  T b_h;

  // Length of the next step of Photoreceptor: y's relaxation, as V's there.
  using Motion = typename Photoreceptor<T>::Motion;
  T step_length(const Photoreceptor<T>& receptor, const Motion& motion, T v, T y) const {
    const T one = number<T>(1), x = receptor.a_h * receptor.i, x_1 = one + b_h, per_b = one / b_h;
    // y follows what is slower with a lag of V' / b - V'' / b^2. Of faster V that is its motion with the light; the
    // photoreceptor's own steps are short enough for the rest.
    const auto fast = x >= b_h;
    const T slope = x * (motion.follows + motion.relaxes), follows = x * motion.follows;
    const T second = receptor.a_h * mul_sub(receptor.i, receptor.slope, slope / receptor.w);
    const T d1 = select(fast, follows, slope), d2 = select(fast, receptor.light.second_derivative(receptor.s), second);
    const T added =
        select_or_zero(b_h <= receptor.steepest + receptor.steepest, receptor.steepest_second / (x_1 * x_1));
    const T r = abs(v - y - per_b * neg_mul_add(per_b, d2, d1)) + added;
    const float tolerance = receptor.tolerance;
    return select(r < tolerance, one, sqrt(sqrt(384 * tolerance / r)) * per_b);
  }

  // y over a step in which V is a cubic from v0 to v1 with slopes d0 and d1 per step; ds: its length.
  struct Step {
    T end;
    Cubic<T> y;
  };
  Step take(T y, T v0, T v1, T d0, T d1, T ds) const {
    const T x = b_h * ds, three = number<T>(3), per_x = 1.0f / x, rise = v1 - v0;
    const T end = receptor_step(y, v0, v1, d0, d1, x);
    // In long steps y's lag is that of slow V, and the rest relaxes as in Photoreceptor::slope_of_v.
    const T second0 = 6.0f * rise - 4.0f * d0 - 2.0f * d1, second1 = 2.0f * d0 + 4.0f * d1 - 6.0f * rise;
    const auto slope = [&](T off, T d, T second) {
      const T lag = per_x * neg_mul_add(per_x, second, d);
      return select(x > 3.0f, mul_add(three, off, (x - three) * lag), x * off);
    };
    return {end, hermite(y, end, slope(v0 - y, d0, second0), slope(v1 - end, d1, second1))};
  }
};

PECS_END_NUMBERS
#endif
