// Photon noise in continuous time (docs/reference/sensor.md, Noise): n is that of the photoreceptor, an
// Ornstein-Uhlenbeck process whose rate follows the light, and z what the amplifier passes of it, dz/dt = b (n - z).
// Both have an exact law over any time, and between two known states. So a path is refined only where it may cross a
// threshold, and the events do not depend on the spacing of frames.
//
// Over a time h: x = r h, y = b h, r: rate of n. Variances are relative to that of n in steady light.
//
// Templates over a number type (number.h).
#if defined(PECS_NOISE_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef PECS_NOISE_H_
#undef PECS_NOISE_H_
#else
#define PECS_NOISE_H_
#endif

#include <numbers>
#include <optional>

#include "models/pecs/photoreceptor.h"

PECS_BEGIN_NUMBERS

template <class T>
struct NoiseState {
  T n, z;
};
// Covariance of n and z.
template <class T>
struct NoiseSpread {
  T nn, nz, zz;
};

// The transition over a time: n1 = e n0 + …, z1 = k n0 + f z0 + …; added / (2 x): covariance of what is new.
template <class T>
struct NoiseStep {
  T x, y, e, f, k;
  NoiseSpread<T> added;

  NoiseState<T> mean(const NoiseState<T>& s) const { return {e * s.n, mul_add(k, s.n, f * s.z)}; }
};

// For short times, x < 0.5 and y < 0.4: the series of the integrals of e(s)^2, e(s) k(s), k(s)^2 over [0, h], per h.
template <class T>
PECS_INLINE NoiseSpread<T> short_spread(T x, T y, T i1) {
  const T sum = x + y, d = y - x, dd = d * d, twice = x + x;
  const T h1 = twice + sum, p2 = sum * sum, h2 = mul_add(twice, h1, p2), p3 = p2 * sum, h3 = mul_add(twice, h2, p3);
  const T p4 = p2 * p2, h4 = mul_add(twice, h3, p4), h5 = mul_add(twice, h4, p4 * sum);
  const T nz = mul_add(h5, number<T>(-1.0 / 5040), h4 * number<T>(1.0 / 720)) - h3 * number<T>(1.0 / 120);
  T zz = mul_add(dd, number<T>(1.0 / 60), number<T>(1.0 / 3)) - 0.25f * sum + 0.1f * p2;
  zz = zz - (p3 * number<T>(1.0 / 36) + sum * dd * number<T>(1.0 / 72));
  zz = zz + p4 * number<T>(1.0 / 168) + p2 * dd * number<T>(1.0 / 168);
  zz = zz - (p4 * sum * number<T>(21.0 / 20160) + p3 * dd * number<T>(35.0 / 20160));
  return {i1, y * (number<T>(0.5) - h1 * number<T>(1.0 / 6) + h2 * number<T>(1.0 / 24) + nz), y * y * zz};
}

// phi1(x) by ex = e^-x.
template <class T>
PECS_INLINE T phi1(T x, T ex) {
  T series = number<T>(1.0 / 5040);
  for (const double c : {-1.0 / 720, 1.0 / 120, -1.0 / 24, 1.0 / 6, -0.5, 1.0})
    series = mul_add(series, x, number<T>(c));
  return select(x < 0.5f, series, (1.0f - ex) / max(x, number<T>(0.5)));
}

// Beyond 1e5, and 1e5 times the photoreceptor's, the amplifier's speed changes nothing that single precision resolves.
template <class T>
PECS_INLINE NoiseStep<T> noise_step(T x, T amplifier_y) {
  const T y = min(amplifier_y, number<T>(1e5) * max(x, number<T>(1)));
  const T e = exp(-x), f = exp(-y), i1 = phi1(x + x, e * e);
  // k = y (e - f) / (y - x)
  const T apart = abs(y - x), larger = max(max(e, f), number<T>(1e-37));
  NoiseStep<T> s{x, y, e, f, y * larger * phi1(apart, min(e, f) / larger), {}};
  const auto is_short = x < 0.5f && y < 0.4f;
  if (any(is_short)) s.added = short_spread(x, y, i1);
  if (all(is_short)) return s;
  // Slow photoreceptor: in closed form. A fast one: the stationary covariance less what is left of it.
  const T share = y / (x + y), beta = y / (y - x), i2 = phi1(x + y, e * f), i3 = phi1(y + y, f * f);
  const auto is_slow = x + x < y;
  const T per = 0.5f / x, left = mul_add(f, share, s.k);
  const auto pick = [&](T brief, T slow, T fast) { return select(is_short, brief, select(is_slow, slow, fast)); };
  s.added = {i1, pick(s.added.nz, beta * (i1 - i2), per * neg_mul_add(e, left, share)),
             pick(s.added.zz, beta * beta * (i1 - (i2 + i2) + i3),
                  per * (share - s.k * s.k - f * (2.0f * s.k * share + f * share)))};
  return s;
}

// Cholesky factor: n = nn g0, z = nz g0 + zz g1 for normal deviates g.
template <class T>
PECS_INLINE NoiseSpread<T> factor_of(const NoiseSpread<T>& c) {
  const T zero = number<T>(0), tiny = number<T>(1e-30);
  const T nn = sqrt(max(c.nn, tiny)), nz = c.nz / nn;
  return {nn, nz, sqrt(max(zero, neg_mul_add(nz, nz, c.zz)))};
}

// The law of the state between two known ones, `first` after start and `second` before end: the mean, and the
// covariance relative to 2 (first.x + second.x) times the variance of n. Where `free`, the end is not known.
template <class T>
struct NoiseBetween {
  NoiseState<T> mean;
  NoiseSpread<T> spread;
};
template <class T>
PECS_INLINE NoiseBetween<T> noise_between(const NoiseStep<T>& first, const NoiseStep<T>& second,
                                          const NoiseState<T>& start, const NoiseState<T>& end, MaskOf<T> free) {
  const T per = 1.0f / (first.x + second.x), w1 = first.x * per, w2 = second.x * per;
  const NoiseSpread<T> q{first.added.nn * w1, first.added.nz * w1, first.added.zz * w1};
  // q Phi^T, Phi: the second transition
  const T a11 = q.nn * second.e, a12 = mul_add(q.nn, second.k, q.nz * second.f);
  const T a21 = q.nz * second.e, a22 = mul_add(q.nz, second.k, q.zz * second.f);
  const T m11 = mul_add(second.added.nn, w2, second.e * a11);
  const T m12 = mul_add(second.added.nz, w2, second.e * a12);
  const T m22 = mul_add(second.added.zz, w2, mul_add(second.k, a12, second.f * a22));
  const T per_det = 1.0f / mul_sub(m11, m22, m12 * m12);
  const auto gain = [&](T u, T v, T& g1, T& g2) {
    g1 = select(free, number<T>(0), mul_sub(u, m22, v * m12) * per_det);
    g2 = select(free, number<T>(0), mul_sub(v, m11, u * m12) * per_det);
  };
  T k11, k12, k21, k22;
  gain(a11, a12, k11, k12);
  gain(a21, a22, k21, k22);
  const NoiseState<T> to = first.mean(start), there = second.mean(to);
  const T dn = end.n - there.n, dz = end.z - there.z;
  return {
      {mul_add(k11, dn, mul_add(k12, dz, to.n)), mul_add(k21, dn, mul_add(k22, dz, to.z))},
      {q.nn - mul_add(k11, a11, k12 * a12), q.nz - mul_add(k11, a21, k12 * a22), q.zz - mul_add(k21, a21, k22 * a22)}};
}
// Draws that state by two normal deviates.
template <class T>
PECS_INLINE NoiseState<T> draw_between(const NoiseStep<T>& first, const NoiseStep<T>& second,
                                       const NoiseState<T>& start, const NoiseState<T>& end, MaskOf<T> free, T std_of_n,
                                       T g0, T g1) {
  const NoiseBetween<T> law = noise_between(first, second, start, end, free);
  const NoiseSpread<T> l = factor_of(law.spread);
  const T scale = std_of_n * sqrt(2.0f * (first.x + second.x));
  return {mul_add(scale * l.nn, g0, law.mean.n), mul_add(scale, mul_add(l.nz, g0, l.zz * g1), law.mean.z)};
}

// Bounds of a path of a given time between two known states.
template <class T>
struct NoiseReach {
  T std;        // upper bound of the standard deviation of z
  T slope_std;  // of dz/dt times the time, for unknown ends
  T sag, over;  // between its ends the mean of z falls towards 0, and overshoots by what n differs from z at them
  struct Bounds {
    T below, above;  // of the mean of z
  };
  Bounds bounds(const NoiseState<T>& s0, const NoiseState<T>& s1) const {
    const T zero = number<T>(0), low = min(s0.z, s1.z), high = max(s0.z, s1.z), d0 = s0.n - s0.z, d1 = s1.z - s1.n;
    return {mul_add(over, min(zero, d0) + min(zero, d1), select(low > 0.0f, low * sag, low)),
            mul_add(over, max(zero, d0) + max(zero, d1), select(high < 0.0f, high * sag, high))};
  }
};
template <class T>
PECS_INLINE NoiseReach<T> noise_reach(T x, T y, T std_of_n) {
  const T one = number<T>(1), share = y / (x + y), xx = 0.25f * x * x;
  // tanh(x / 2), the variance of n in the middle, by a bound from above (Pade).
  const T bow = min(one, 0.5f * x * (15.0f + xx) / mul_add(number<T>(6), xx, number<T>(15)));
  return {std_of_n * sqrt(min(min(bow, share), x * y * y * number<T>(1.0 / 96))), std_of_n * sqrt(x * y * share),
          sqrt(neg_mul_add(bow, bow, one)), min(share, 0.15f * y)};
}

// The share of its standard deviation that noise moves within some of the amplifier's times: 1 unless the light is dim.
// Also for x = 0 and infinity.
template <class T>
PECS_INLINE T share_moved(T x, T y) {
  const T one = number<T>(1), square = number<T>(1000) / (one + y / x);
  return select(square < one, sqrt(square), one);
}

// Upper bound of the expected number of crossings of a level at `distance` from what the mean reaches (Rice, Bell Syst.
// Tech. J. 24, 1945, between two known states; tests/sensor/exact_pixel_test.cpp), at most kManyCrossings: not small.
// slope: the largest of the light's part towards the level, times the time.
inline constexpr float kManyCrossings = 2;
template <class T>
PECS_INLINE T most_crossings(T distance, T slope, const NoiseReach<T>& reach) {
  const T per_std = 1.0f / max(reach.std, number<T>(1e-20)), d = distance * per_std;
  const T speed = mul_add(reach.slope_std, mul_add(number<T>(0.125), d, number<T>(0.1)), max(slope, number<T>(0)));
  const T expected = speed * per_std * number<T>(0.39894228) * exp(max(number<T>(-80), -0.5f * d * d));
  return select(d < 1.2f, number<T>(kManyCrossings), min(expected, number<T>(kManyCrossings)));
}

// A crossing of a level by noise on its way between two known states, drawn at a given time.
struct NoiseCrossing {
  double x, y, u;  // over the whole way; u: the time's share of it
  NoiseState<double> start, end;
  double std_of_n, sign;  // 1: upwards, -1: downwards

  // `most`: upper bound of the density over the way. level: of z; slope: of the light's part, over the way. next:
  // uniforms in (0, 1). The noise at the crossing, or none with the probability that the density lacks.
  template <class Next>
  std::optional<NoiseState<double>> draw(double level, double slope, double most, Next&& next) const {
    const auto bell = [](double v) { return std::exp(-0.5 * v * v) / std::sqrt(2 * std::numbers::pi); };
    const auto below = [](double v) { return 0.5 * std::erfc(-v / std::numbers::sqrt2); };
    const NoiseBetween<double> law =
        noise_between(noise_step(x * u, y * u), noise_step(x * (1 - u), y * (1 - u)), start, end, false);
    const double scale = 2 * x * std_of_n * std_of_n, std_z = std::sqrt(law.spread.zz * scale);
    const double per_zz = law.spread.nz / law.spread.zz, off = level - law.mean.z;
    // Slope of the output given that it is at the level, towards it: mean, and standard deviation.
    const double mean = sign * (slope + y * (law.mean.n + per_zz * off - level));
    const double std = y * std::sqrt(scale * std::max(0.0, law.spread.nn - per_zz * law.spread.nz)), a = mean / std;
    const double upwards = bell(a) + a * below(a);
    if (!(next() * most < bell(off / std_z) / std_z * std * upwards)) return std::nullopt;
    // That slope / std has the density v bell(v - a) / upwards at a crossing: its distribution, inverted by bisection.
    const double part = next() * upwards;
    double low = 0, high = std::max(0.0, a) + 12;
    for (int i = 0; i < 48; ++i) {
      const double v = 0.5 * (low + high);
      (bell(a) - bell(v - a) + a * (below(v - a) - below(-a)) < part ? low : high) = v;
    }
    return NoiseState<double>{level + (sign * std * low - slope) / y, level};
  }
};

PECS_END_NUMBERS
#endif
