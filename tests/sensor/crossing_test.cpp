// Crossings of a cubic, and the photoreceptor's step, against closed forms.
#include "pecs/sensor/crossing.h"

#include <gtest/gtest.h>

#include <cmath>

#include "pecs/sensor/photoreceptor.h"

namespace pecs::sensor {

TEST(Crossing, FirstOfSeveral) {
  const Cubic q{0, 3, -9, 6};  // rises to 0.289 at 0.211, falls to -0.289 at 0.789, ends at 0
  const Crossing up = first_crossing(q, 0, -0.2, 0.2);
  EXPECT_TRUE(up.on);
  EXPECT_NEAR(q.at(up.s), 0.2, 1e-9);
  EXPECT_LT(up.s, 0.211);
  const Crossing down = first_crossing(q, 0, -0.2, 0.3);
  EXPECT_FALSE(down.on);
  EXPECT_NEAR(q.at(down.s), -0.2, 1e-9);
  EXPECT_GT(first_crossing(q, 0, -0.3, 0.3).s, 1);
  EXPECT_GT(first_crossing(q, down.s + 1e-3, -0.3, 0.2).s, 1);
}

TEST(Crossing, EveryShapeAgainstADenseSearch) {
  int crossings = 0;
  for (double m0 = -4; m0 <= 4; m0 += 0.5)
    for (double m1 = -4; m1 <= 4; m1 += 0.5)
      for (double v1 = -1; v1 <= 1; v1 += 0.25) {
        const Cubic q = hermite(0, v1, m0, m1);
        double dense = 2;
        for (int i = 0; i <= 20000 && dense > 1; ++i)
          if (std::abs(q.at(i / 20000.0)) >= 0.3) dense = i / 20000.0;
        const Crossing found = first_crossing(q, 0, -0.3, 0.3);
        if (dense <= 1) {
          ++crossings;
          ASSERT_NEAR(found.s, dense, 6e-5) << m0 << ' ' << m1 << ' ' << v1;
        } else if (found.s <= 1) {  // touched between two samples
          ASSERT_NEAR(std::abs(q.at(found.s)), 0.3, 1e-6);
        }
      }
  EXPECT_GT(crossings, 1000);
}

TEST(Photoreceptor, ConstantLightIsTheLogisticCurve) {
  for (const double x : {1e-6, 0.01, 0.3, 3.0, 40.0}) {
    const double light = 2.5, u0 = 0.2;
    const double u1 = light * u0 * std::exp(x) / (light + u0 * (std::exp(x) - 1));  // docs/sensor.md, x = a I dt
    EXPECT_NEAR(1 / receptor_step(1 / u0, 1 / light, 1 / light, 0, 0, x), u1, 1e-12 * light);
  }
}

// V all along the interval, in light that bends, rises and falls, at speeds from slow to stiff.
TEST(Photoreceptor, VaryingLightAgainstRungeKutta) {
  for (const LogLight light : {LogLight{0.0, 1.5, 0.3, 2.0}, {0, -1.5, 0, 0}, {0, 0.2, 0.5, -0.1}, {0, 2.3, 0, 6}})
    for (const double a : {0.01, 0.3, 1.0, 5.0, 20.0, 200.0}) {
      const int n = 100000;
      double v = a < 3 ? -0.7 : light.l0 - light.m0 / a;
      Receptor receptor(light, a, std::exp(-v));
      auto step = receptor.next();
      double worst = 0;
      int steps = 1;
      const auto slope = [&](double s, double at) { return a * (std::exp(light.at(s)) - std::exp(at)); };
      for (int i = 0; i < n; ++i) {
        const double s = static_cast<double>(i) / n, h = 1.0 / n;
        if (s >= step.s1) {
          step = receptor.next();
          ++steps;
        }
        const double ds = step.s1 - step.s0;
        worst = std::max(worst, std::abs(hermite(step.v0, step.v1, step.m0, step.m1).at((s - step.s0) / ds) - v));
        const double k1 = slope(s, v), k2 = slope(s + h / 2, v + h / 2 * k1), k3 = slope(s + h / 2, v + h / 2 * k2);
        v += h / 6 * (k1 + 2 * k2 + 2 * k3 + slope(s + h, v + h * k3));
      }
      EXPECT_LT(worst, 1e-3) << light.l1 << " a " << a << " in " << steps << " steps";
      EXPECT_NEAR(-std::log(receptor.w()), v, 1e-3);
      EXPECT_LT(steps, 20) << a;
    }
}

}  // namespace pecs::sensor
