#include "pecs/lens/diffraction.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <vector>

namespace pecs::lens {
namespace {

constexpr int kSize = 129, kMiddle = 64;
constexpr std::size_t kPixels = std::size_t{kSize} * kSize;
constexpr double kPitch = 0.00486, kLambda = 550, kN = 18.8;

std::vector<float> point() {
  std::vector<float> picture(kPixels, 0.f);
  picture[kMiddle * kSize + kMiddle] = 1.f;
  return picture;
}

TEST(Diffraction, UniformStaysUniform) {
  std::vector<float> picture(1200, 3.5f);
  diffract(picture, 40, 30, kPitch, kLambda, kN);
  for (const float v : picture) EXPECT_NEAR(v, 3.5, 1e-6);
}

TEST(Diffraction, APointBecomesTheAiryPattern) {
  std::vector<float> picture = point();
  diffract(picture, kSize, kSize, kPitch, kLambda, kN);
  // At F/18.8 and 550 nm the pattern's cut-off lies below the grid's, so samples are the pattern itself:
  // pi / (2 lambda N)^2 pitch^2 (2 J1(v) / v)^2, v = pi r / (lambda N).
  const double lambda_n = kLambda * 1e-6 * kN, peak = std::numbers::pi / (4 * lambda_n * lambda_n) * kPitch * kPitch;
  for (int i = 0; i < 8; ++i) {
    const double v = std::numbers::pi * i * kPitch / lambda_n;
    double airy = 0, term = 1;  // 2 J1(v) / v by its series: libc++ has no cyl_bessel_j
    for (int k = 1; k < 60; term *= -v * v / (4.0 * k * (k + 1)), ++k) airy += term;
    EXPECT_NEAR(picture[kMiddle * kSize + kMiddle + i], peak * airy * airy, 2e-3 * peak) << i;
  }
  EXPECT_NEAR(std::accumulate(picture.begin(), picture.end(), 0.0), 1.0, 0.01);  // the rest is outside the kernel
  EXPECT_NEAR(airy_radius_mm(kLambda, kN) / kPitch, 2.6, 0.01);
}

TEST(Diffraction, AGratingKeepsItsMeanAndLosesTheMtf) {
  const int period = 8;
  std::vector<float> picture(kPixels);
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x)
      picture[y * kSize + x] = static_cast<float>(1 + 0.5 * std::cos(2 * std::numbers::pi * (x + 0.5) / period));
  diffract(picture, kSize, kSize, kPitch, kLambda, kN);
  const double mtf = diffraction_mtf(1 / (period * kPitch), kLambda, kN);
  EXPECT_GT(mtf, 0.3);
  for (int x = 48; x < 80; ++x)
    EXPECT_NEAR(picture[kMiddle * kSize + x], 1 + 0.5 * mtf * std::cos(2 * std::numbers::pi * (x + 0.5) / period),
                2e-3);
}

TEST(Diffraction, NeverNegative) {
  std::vector<float> picture = point();
  diffract(picture, kSize, kSize, kPitch, 450, 2.8);
  for (const float v : picture) EXPECT_GE(v, 0.f);
}

TEST(Diffraction, OfADifferenceIsTheDifference) {
  std::vector<float> difference = point(), mirror = point();
  std::ranges::for_each(mirror, [](float& v) { v = -v; });
  difference[kMiddle] = mirror[kMiddle] = -1e-6f;  // neither is irradiance
  diffract(difference, kSize, kSize, kPitch, 450, 2.8);
  diffract(mirror, kSize, kSize, kPitch, 450, 2.8);
  EXPECT_LT(*std::ranges::min_element(mirror), -0.5f);
  for (std::size_t i = kSize; i < kPixels; ++i) EXPECT_NEAR(difference[i], -mirror[i], 1e-6);
}

}  // namespace
}  // namespace pecs::lens
