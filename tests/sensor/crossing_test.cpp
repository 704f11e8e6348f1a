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
    EXPECT_NEAR(1 / receptor_step(1 / u0, 1 / light, 1 / light, x), u1, 1e-12 * light);
  }
}

TEST(Photoreceptor, VaryingLightAgainstRungeKutta) {
  const LogLight light{0.0, 1.5, 0.3, 2.0};
  for (const double a : {0.01, 1.0, 20.0}) {
    double u = 0.5;
    const int n = 100000;
    const auto slope = [&](double s, double v) { return a * v * (std::exp(light.at(s)) - v); };
    for (int i = 0; i < n; ++i) {
      const double s = static_cast<double>(i) / n, h = 1.0 / n;
      const double k1 = slope(s, u), k2 = slope(s + h / 2, u + h / 2 * k1), k3 = slope(s + h / 2, u + h / 2 * k2);
      u += h / 6 * (k1 + 2 * k2 + 2 * k3 + slope(s + h, u + h * k3));
    }
    const int steps = receptor_steps(a * 2.7, 1.5, 0.7);
    double w = 2;
    for (int i = 0; i < steps; ++i)
      w = receptor_advance(w, light, static_cast<double>(i) / steps, static_cast<double>(i + 1) / steps, a);
    EXPECT_NEAR(-std::log(w), std::log(u), 1e-3) << a;
  }
}

}  // namespace pecs::sensor
