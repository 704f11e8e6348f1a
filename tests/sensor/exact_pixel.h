#pragma once
// The same algorithm in double precision, one pixel at a time: what the kernels do in vectors of floats
// (sensor/src/models/pecs/) is compared with it. The product's photoreceptor meets Runge-Kutta in
// photoreceptor_test.cpp.
//
// The charge-type (logistic) photoreceptor (docs/reference/sensor.md): du/dt = a u (I - u), V = ln u, with a = 2 pi *
// corner per ampere. A node charged by the photocurrent I and discharged by a current u that is exponential in V: its
// corner, a I / 2 pi, follows the light, and it answers darkening more slowly than brightening.
//
// In w = 1/u it is linear: dw/dX = 1/I - w, with dX = a I dt. So over a step
//   w1 = e^-X w0 + integral over [0, X] of e^-(X-x) g(x) dx,  g = 1/I,
// and with g a polynomial in x the integral has a closed form: exact for constant light, and stable for any X.
#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

namespace pecs::sensor {

// (1 - e^-X) / X
inline double phi1(double x) { return x < 1e-4 ? 1 - x / 2 + x * x / 6 : -std::expm1(-x) / x; }

// One step over exposure X with g the cubic from g0 to g1 that has slopes d0 and d1 per X at its ends.
inline double receptor_step(double w0, double g0, double g1, double d0, double d1, double x) {
  // Integrals of e^-(X-x) (x/X)^n: j0 = 1 - e^-X, j_n = 1 - n j_(n-1) / X.
  const double phi = phi1(x), j0 = x * phi, j1 = 1 - phi, j2 = 1 - 2 * j1 / x, j3 = 1 - 3 * j2 / x;
  const double rise = g1 - g0;
  return w0 + j0 * (g0 - w0) + d0 * j1 + (3 * rise - 2 * d0 - d1) * j2 + (d0 + d1 - 2 * rise) * j3;
}

// The input between two frames: ln I as a cubic in s in [0, 1], given by values and slopes (per unit of s) at the ends.
struct LogLight {
  double l0, l1, m0, m1;
  double at(double s) const {
    const double r = 1 - s;
    return l0 * (1 + 2 * s) * r * r + l1 * s * s * (3 - 2 * s) + s * r * (m0 * r - m1 * s);
  }
  double slope(double s) const {
    const double r = 1 - s;
    return 6 * s * r * (l1 - l0) + m0 * r * (1 - 3 * s) + m1 * s * (3 * s - 2);
  }
  double bend(double s) const { return 6 * (1 - 2 * s) * (l1 - l0) + (6 * s - 4) * m0 + (6 * s - 2) * m1; }
  // No second derivative is greater.
  double steepest_bend() const { return std::max(std::abs(bend(0)), std::abs(bend(1))); }
  // No slope is greater.
  double steepest() const {
    return std::max({1.5 * std::abs(l1 - l0) + 0.25 * (std::abs(m0) + std::abs(m1)), std::abs(m0), std::abs(m1)});
  }
};

// The photoreceptor within an interval, in steps of its own choice: one in steady light, more where it must relax.
class Receptor {
 public:
  // a_h: a * duration of the interval.
  Receptor(const LogLight& light, double a_h, double w)
      : light_(light),
        a_h_(a_h),
        steepest_(light.steepest()),
        steepest_bend_(light.steepest_bend()),
        w_(w),
        i_(std::exp(light.l0)),
        slope_(light.m0),
        v_(-std::log(w)) {}

  // One step: V from v0 at s0 to v1 at s1, with slopes m0 and m1 per step. Its error is about kTolerance.
  struct Step {
    double s0, s1, v0, v1, m0, m1;
  };
  Step next() {
    const double rest = 1 - s_;
    const double ds = rest / std::min(std::ceil(rest / wanted()), 1e6);
    const double s1 = rest - ds > 1e-9 ? s_ + ds : 1;
    const double i1 = std::exp(light_.at(s1)), slope1 = light_.slope(s1);
    const double x = a_h_ * ds / 6 * (i_ + 4 * std::exp(light_.at((s_ + s1) / 2)) + i1);  // Simpson
    const double k0 = a_h_ * i_, k1 = a_h_ * i1;
    Step step{s_, s1, v_, 0, slope(ds), 0};
    w_ = receptor_step(w_, 1 / i_, 1 / i1, -x * slope_ / (k0 * i_), -x * slope1 / (k1 * i1), x);
    s_ = s1;
    i_ = i1;
    slope_ = slope1;
    step.v1 = v_ = -std::log(w_);
    step.m1 = slope(ds);
    return step;
  }
  double w() const { return w_; }

 private:
  static constexpr double kTolerance = 2e-4, kMostChange = 0.5;
  // (dV/ds) / (a_h I) = 1 - u / I: of V that follows the light, and of what relaxes towards that. In fast light
  // dV/ds = l' + (l'^2 - l'') / (a_h I) to second order in 1 / (a_h I).
  struct Motion {
    double follows, relaxes;
  };
  Motion motion() const {
    const double x = a_h_ * i_;
    double follows = slope_ / x;
    if (x > 2 * steepest_) follows += (slope_ * slope_ - light_.bend(s_)) / (x * x);
    return {follows, 1 - 1 / (w_ * i_) - follows};
  }
  // dV/ds times ds; a relaxation that is over within the step counts as one of three time constants.
  double slope(double ds) const {
    const double x = a_h_ * i_ * ds;
    const Motion m = motion();
    return x * m.follows + std::min(x, 3.0) * m.relaxes;
  }
  // Length of the next step. The error of a cubic through a relaxation of amplitude r is r (ds / time constant)^4 /
  // 384; r: what relaxes now and, in slow light, what the light's bend adds within the step.
  double wanted() const {
    const double x = a_h_ * std::max(i_, 1 / w_);
    double r = std::abs(motion().relaxes);
    if (x <= 2 * steepest_) r += steepest_bend_ / ((1 + x) * (1 + x));
    const double relaxation = r < kTolerance ? 1 : std::sqrt(std::sqrt(384 * kTolerance / r)) / x;
    return std::min({1.0, kMostChange / steepest_, relaxation});
  }

  LogLight light_;
  double a_h_, steepest_, steepest_bend_, w_, i_, slope_, v_, s_ = 0;
};

// c0 + c1 s + c2 s^2 + c3 s^3 on [0, 1].
struct Cubic {
  double c0, c1, c2, c3;
  double at(double s) const { return c0 + s * (c1 + s * (c2 + s * c3)); }
};

struct Crossing {
  double s;  // > 1: none
  bool on;
};
// q(s) = level in [a, b], where q is monotone and crosses it: Newton, kept in the bracket.
inline double solve(const Cubic& q, double level, double a, double b) {
  const double at_a = q.at(a), at_b = q.at(b);
  const bool rising = at_b > at_a;
  double s = a + (b - a) * std::clamp((level - at_a) / (at_b - at_a), 0.0, 1.0);
  for (int i = 0; i < 60 && b - a > 1e-12; ++i) {
    const double f = q.at(s) - level;
    ((f < 0) == rising ? a : b) = s;
    const double slope = q.c1 + s * (2 * q.c2 + s * 3 * q.c3);
    double next = s - f / slope;
    if (!(next > a && next < b)) next = (a + b) / 2;
    if (std::abs(next - s) < 1e-5) return next;  // the next step would be some 1e-10
    s = next;
  }
  return s;
}

inline Cubic hermite(double v0, double v1, double m0, double m1) {
  return {v0, m0, 3 * (v1 - v0) - 2 * m0 - m1, 2 * (v0 - v1) + m0 + m1};
}

// The first s >= from where the cubic is >= high (on) or <= low (off).
inline Crossing first_crossing(const Cubic& q, double from, double low, double high) {
  const double start = q.at(from);
  if (start >= high) return {from, true};
  if (start <= low) return {from, false};

  // Monotone pieces end where 3 c3 s^2 + 2 c2 s + c1 = 0.
  double ends[3];
  int pieces = 0;
  const double root2 = q.c2 * q.c2 - 3 * q.c3 * q.c1;
  if (root2 > 0) {
    const double t = -(q.c2 + std::copysign(std::sqrt(root2), q.c2));
    double r0 = q.c3 != 0 ? t / (3 * q.c3) : 2, r1 = t != 0 ? q.c1 / t : 2;
    if (r0 > r1) std::swap(r0, r1);
    for (const double r : {r0, r1})
      if (r > from && r < 1) ends[pieces++] = r;
  }
  ends[pieces++] = 1;

  double a = from;
  for (int i = 0; i < pieces; ++i) {
    const double end = q.at(ends[i]);
    if (end >= high) return {solve(q, high, a, ends[i]), true};
    if (end <= low) return {solve(q, low, a, ends[i]), false};
    a = ends[i];
  }
  return {2, false};
}

// One pixel. V is the photoreceptor's output (ln). No noise.
struct ExactPixel {
  double a_per_us, leak_per_us, refractory_us, threshold_on, threshold_off;
  double w = 0;          // photoreceptor state 1/u
  double reference = 0;  // V at the last reset
  double blind_us = 0;   // time left until the reference is taken

  struct Fired {
    double t_us;
    bool on;
  };

  // The interval from t0_us; light: slopes per interval.
  void step(double t0_us, double h_us, const LogLight& light, std::vector<Fired>& events) {
    std::optional<Receptor> receptor;
    if (a_per_us > 0) receptor.emplace(light, a_per_us * h_us, w);
    const double drift = leak_per_us * h_us;
    double blind_until = blind_us;
    for (double from = 0; from < 1;) {
      const Receptor::Step r =
          receptor ? receptor->next() : Receptor::Step{0, 1, light.l0, light.l1, light.m0, light.m1};
      from = r.s1;
      const double n0 = drift * r.s0, n1 = drift * r.s1;
      const Cubic q = hermite(r.v0 + n0, r.v1 + n1, r.m0 + n1 - n0, r.m1 + n1 - n0);
      const double start = r.s0 * h_us, end = r.s1 * h_us, h = end - start;
      double s = 0;
      if (blind_us > 0) {
        if (blind_until >= end) continue;
        s = std::max(0.0, (blind_until - start) / h);
        reference = q.at(s);
        blind_us = 0;
      }
      while (true) {
        const Crossing next = first_crossing(q, s, reference - threshold_off, reference + threshold_on);
        if (next.s > 1) break;
        events.push_back({t0_us + start + next.s * h, next.on});
        s = next.s;
        if (refractory_us > 0) {
          blind_until = start + next.s * h + refractory_us;
          if (blind_until >= end) {
            blind_us = blind_until;
            break;
          }
          s = (blind_until - start) / h;
        }
        reference = q.at(s);
      }
    }
    if (blind_us > 0) blind_us = std::max(blind_until - h_us, 1e-6);
    reference -= drift;
    if (receptor) w = receptor->w();
  }
};

}  // namespace pecs::sensor
