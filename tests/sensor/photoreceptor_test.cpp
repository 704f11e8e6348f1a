// The photoreceptor, and the amplifier behind it, against Runge-Kutta: as vectors of floats (on the baseline
// instruction set), as float and as double.
#include <gtest/gtest.h>
#include <hwy/highway.h>

#include <cmath>

#include "models/pecs/math-inl.h"
// then
#include "models/pecs/amplifier.h"

namespace pecs::sensor::HWY_NAMESPACE {
namespace {

struct Light {
  double l1, m0, m1;  // ln I from 0 to l1; slopes at the ends
  double at(double s) const {
    const double r = 1 - s;
    return l1 * s * s * (3 - 2 * s) + s * r * (m0 * r - m1 * s);
  }
};
constexpr Light kLights[] = {{1.5, 0.3, 2.0}, {-1.5, 0, 0}, {0.2, 0.5, -0.1}, {2.3, 0, 6}};
constexpr double kSpeeds[] = {0.01, 0.3, 1, 5, 20, 200};

double value(V v) { return static_cast<double>(hn::GetLane(v)); }
double value(double v) { return v; }

double rest(const Light& light, double a) { return a < 3 ? -0.7 : -light.m0 / a; }

// dV/ds = a (I - e^V) from s = 0; visit(s, V) on the way.
template <class Visit>
double runge_kutta(const Light& light, double a, double v, const Visit& visit, int n = 100000) {
  const double h = 1.0 / n;
  const auto slope = [&](double s, double at) { return a * (std::exp(light.at(s)) - std::exp(at)); };
  for (int i = 0; i < n; ++i) {
    const double s = i * h;
    visit(s, v);
    const double k1 = slope(s, v), k2 = slope(s + h / 2, v + h / 2 * k1), k3 = slope(s + h / 2, v + h / 2 * k2);
    v += h / 6 * (k1 + 2 * k2 + 2 * k3 + slope(s + h, v + h * k3));
  }
  return v;
}

// The same with dy/ds = b (V - y) behind it.
template <class Visit>
double runge_kutta(const Light& light, double a, double b, double v, double y, const Visit& visit) {
  const int n = 20000;
  const double h = 1.0 / n;
  runge_kutta(
      light, a, v,
      [&](double s, double v0) {
        // V over the step is its Taylor polynomial: exact enough for a pole that is not faster than the step.
        const auto dv = [&](double at, double x) { return a * (std::exp(light.at(x)) - std::exp(at)); };
        const double slope = dv(v0, s), middle = v0 + h / 2 * dv(v0 + h / 4 * slope, s + h / 4),
                     end = v0 + h * dv(middle, s + h / 2);
        visit(s, y);
        const double k1 = b * (v0 - y), k2 = b * (middle - y - h / 2 * k1), k3 = b * (middle - y - h / 2 * k2);
        y += h / 6 * (k1 + 2 * k2 + 2 * k3 + b * (end - y - h * k3));
      },
      n);
  return y;
}

template <class T>
struct PhotoreceptorOf : testing::Test {};
using NumberTypes = testing::Types<V, float, double>;
TYPED_TEST_SUITE(PhotoreceptorOf, NumberTypes);

// V throughout the interval, in light that curves, rises and falls, from slow to stiff.
TYPED_TEST(PhotoreceptorOf, AdaptiveStepsAgainstRungeKutta) {
  using T = TypeParam;
  for (const Light& light : kLights)
    for (const double a : kSpeeds) {
      const double v0 = rest(light, a);
      const T zero = number<T>(0);
      const Cubic<T> l = hermite(zero, number<T>(light.l1), number<T>(light.m0), number<T>(light.m1));
      Photoreceptor<T> r{l, 2e-4f, number<T>(a), zero, zero, zero, number<T>(std::exp(-v0)), number<T>(1), l.c1};
      r.bound();
      Cubic<T> piece{};
      double begin = 0, end = 0, worst = 0;
      int steps = 0;
      const auto next = [&] {
        const auto step = r.choose(r.motion(), number<T>(1));
        const T before = -log(r.w);
        r.take(zero <= zero, step.ds, step.end);
        r.s = step.end;
        piece = hermite(before, -log(r.w), step.slope_of_v, r.slope_of_v(r.motion(), step.ds));
        begin = end;
        end = value(step.end);
        ++steps;
      };
      next();
      const double last = runge_kutta(light, a, v0, [&](double s, double v) {
        if (s >= end) next();
        worst = std::max(worst, std::abs(value(piece.at(number<T>((s - begin) / (end - begin)))) - v));
      });
      EXPECT_LT(worst, 1e-3) << light.l1 << " a " << a << " in " << steps << " steps";
      EXPECT_NEAR(-std::log(value(r.w)), last, 1e-3) << light.l1 << " a " << a;
      EXPECT_LT(steps, 20) << a;
    }
}

// y throughout the interval, and at its end, from slow to stiff amplifiers, at rest and behind a step.
TYPED_TEST(PhotoreceptorOf, AmplifiedStepsAgainstRungeKutta) {
  using T = TypeParam;
  constexpr float kTolerance = 4e-4f;  // as the kernel's
  for (const Light& light : kLights)
    for (const double a : kSpeeds)
      for (const double b : {0.2, 3.0, 30.0, 400.0})
        for (const double off : {0.0, 0.3}) {
          const double v0 = rest(light, a), y0 = v0 - off;
          const T zero = number<T>(0);
          const Cubic<T> l = hermite(zero, number<T>(light.l1), number<T>(light.m0), number<T>(light.m1));
          Photoreceptor<T> r{l,   kTolerance, number<T>(a), zero, zero, zero, number<T>(std::exp(-v0)), number<T>(1),
                             l.c1};
          r.bound();
          const Amplifier<T> amplifier{number<T>(b)};
          typename Amplifier<T>::Step piece{number<T>(y0), {}};
          double begin = 0, end = 0, worst = 0;
          int steps = 0;
          const auto next = [&] {
            const auto now = r.motion();
            const T before = -log(r.w);
            const auto step = r.choose(now, amplifier.step_length(r, now, before, piece.end));
            r.take(zero <= zero, step.ds, step.end);
            r.s = step.end;
            piece = amplifier.take(piece.end, before, -log(r.w), step.slope_of_v, r.slope_of_v(r.motion(), step.ds),
                                   step.ds);
            begin = end;
            end = value(step.end);
            ++steps;
          };
          next();
          const double last = runge_kutta(light, a, b, v0, y0, [&](double s, double y) {
            if (s >= end) next();
            worst = std::max(worst, std::abs(value(piece.y.at(number<T>((s - begin) / (end - begin)))) - y));
          });
          EXPECT_LT(worst, 2e-3) << light.l1 << " a " << a << " b " << b << " off " << off << " in " << steps
                                 << " steps";
          EXPECT_NEAR(value(piece.end), last, 1e-3) << light.l1 << " a " << a << " b " << b << " off " << off;
          EXPECT_LT(steps, 30) << a << " b " << b << " off " << off;
        }
}

// The fast path for intervals in which the light changes little: its error grows with the light's curvature, to 4e-3 at
// the largest change that it is used for. V stays within its bounds. Behind it y has an error of the same size: a
// relaxation that ends early counts as one of three time constants.
TYPED_TEST(PhotoreceptorOf, TwoHalfStepsAgainstRungeKutta) {
  using T = TypeParam;
  for (const Light& light : {Light{0.12, 0.1, 0.15}, {-0.12, -0.05, -0.2}, {0.02, 0.04, 0.01}, {0, 0, 0}})
    for (const double a : kSpeeds) {
      const double tolerance = std::abs(light.l1) > 0.02 ? 5e-3 : 5e-4;
      const double v0 = 0.05 + rest({light.l1, light.m0, light.m1}, std::max(a, 3.0)), w0 = std::exp(-v0);
      const double i1 = std::exp(light.l1);
      const IntervalLight<T> l{number<T>(0), number<T>(light.l1), number<T>(light.m0), number<T>(light.m1),
                               number<T>(1), number<T>(i1),       number<T>(1),        number<T>(1 / i1)};
      const Response<T> r = two_half_steps(l, number<T>(w0), 1, static_cast<float>(a));
      double low = 1e9, high = -1e9;
      const double last = runge_kutta(light, a, v0, [&](double, double v) {
        low = std::min(low, v);
        high = std::max(high, v);
      });
      const double v1 = -std::log(value(r.w));
      EXPECT_NEAR(v1, last, tolerance) << light.l1 << " a " << a;
      if (light.l1 == 0) {  // the exposure is known
        const T relaxation = relaxation_of(r.exposure, number<T>(v0), number<T>(v1), number<T>(std::exp(v0)),
                                           number<T>(std::exp(v1)), number<T>(a));
        EXPECT_NEAR(value(relaxation), a - (v1 - v0), 1e-6 + 1e-3 * a) << a;
      }
      T bound_low = min(number<T>(v0), number<T>(v1)), bound_high = max(number<T>(v0), number<T>(v1));
      widen_to_hull(number<T>(v0), number<T>(v1), number<T>(a), number<T>(1 - 1 / w0), number<T>(i1 - std::exp(v1)),
                    number<T>(0), bound_low, bound_high);
      EXPECT_LT(value(bound_low), low + tolerance) << light.l1 << " a " << a;
      EXPECT_GT(value(bound_high), high - tolerance) << light.l1 << " a " << a;
      for (const double b : {0.01, 0.2, 3.0, 30.0, 400.0}) {
        const auto slope = [&](double m, double i, double v) {
          return whole_slope(number<T>(m), static_cast<float>(a), number<T>(i), number<T>(1 / i),
                             number<T>(std::exp(v)));
        };
        const T y = amplified(number<T>(v0), number<T>(v0), number<T>(v1), slope(light.m0, 1, v0),
                              slope(light.m1, i1, v1), amplifier_weights(b));
        EXPECT_NEAR(value(y), runge_kutta(light, a, b, v0, v0, [](double, double) {}), 5e-3)
            << light.l1 << " a " << a << " b " << b;
      }
    }
}

}  // namespace
}  // namespace pecs::sensor::HWY_NAMESPACE
