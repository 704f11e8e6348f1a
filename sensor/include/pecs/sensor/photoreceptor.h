#pragma once
// The charge-type (logistic) photoreceptor (docs/sensor.md): du/dt = a u (I - u), V = ln u, with a = 2 pi * corner per
// ampere. A node charged by the photocurrent I and discharged by a current u that is exponential in V: its corner,
// a I / 2 pi, follows the light, and it answers darkening more slowly than brightening.
//
// In w = 1/u it is linear: dw/dX = 1/I - w, with dX = a I dt. So over a step
//   w1 = e^-X w0 + integral over [0, X] of e^-(X-x) g(x) dx,  g = 1/I,
// and with g a polynomial in x the integral has a closed form: exact for constant light, and stable for any X.
#include <algorithm>
#include <cmath>

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

}  // namespace pecs::sensor
