#pragma once
// The charge-type (logistic) photoreceptor (docs/sensor.md): du/dt = a u (I - u), V = ln u, with a = 2 pi * corner per
// ampere. A node charged by the photocurrent I and discharged by a current u that is exponential in V: its corner,
// a I / 2 pi, follows the light, and it answers darkening more slowly than brightening.
//
// In w = 1/u it is linear: dw/dX = 1/I - w, with dX = a I dt. So over a step
//   w1 = e^-X w0 + integral over [0, X] of e^-(X-x) g(x) dx,  g = 1/I,
// and with g linear in x the integral has a closed form: exact for constant light, and stable for any X.
#include <cmath>

namespace pecs::sensor {

// (1 - e^-X) / X
inline double phi1(double x) { return x < 1e-4 ? 1 - x / 2 + x * x / 6 : -std::expm1(-x) / x; }

// One step with g from g0 to g1 over exposure X.
inline double receptor_step(double w0, double g0, double g1, double x) {
  const double phi = phi1(x);
  const double e = 1 - x * phi;  // e^-X
  return g0 + e * (w0 - g0) + (g1 - g0) * (1 - phi);
}

// The input between two frames: ln I as a cubic in s in [0, 1], given by values and slopes (per unit of s) at the ends.
struct LogLight {
  double l0, l1, m0, m1;
  double at(double s) const {
    const double r = 1 - s;
    return l0 * (1 + 2 * s) * r * r + l1 * s * s * (3 - 2 * s) + s * r * (m0 * r - m1 * s);
  }
};

// From w at s0 to w at s1; `a_h` = a * duration of the whole interval.
inline double receptor_advance(double w0, const LogLight& light, double s0, double s1, double a_h) {
  const double i0 = std::exp(light.at(s0)), im = std::exp(light.at((s0 + s1) / 2)), i1 = std::exp(light.at(s1));
  const double d = a_h * (s1 - s0) / 24;  // exposure of each half, with I a parabola
  const double wm = receptor_step(w0, 1 / i0, 1 / im, std::max(0.0, d * (5 * i0 + 8 * im - i1)));
  return receptor_step(wm, 1 / im, 1 / i1, std::max(0.0, d * (5 * i1 + 8 * im - i0)));
}

}  // namespace pecs::sensor
