#include "pecs/lens/diffraction.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <stdexcept>
#include <unsupported/Eigen/FFT>
#include <vector>

namespace pecs::lens {
namespace {

using Complex = std::complex<double>;

// A length >= n with factors 2, 3, 5 only.
int fast_length(int n) {
  for (;; ++n) {
    int rest = n;
    for (const int p : {2, 3, 5})
      while (rest % p == 0) rest /= p;
    if (rest == 1) return n;
  }
}

// Position in 0..n-1 of i with mirrored borders (edge pixels repeated).
int mirrored(int i, int n) {
  const int period = 2 * n;
  int j = ((i % period) + period) % period;
  return j < n ? j : period - 1 - j;
}

// Transforms every line of `count` lines of `length` values, `stride` apart within a line.
void transform(std::vector<Complex>& data, int count, int length, int between, int stride, bool forward) {
  tbb::parallel_for(tbb::blocked_range<int>(0, count, 16), [&](const tbb::blocked_range<int>& lines) {
    Eigen::FFT<double> fft;
    std::vector<Complex> in(length), out(length);
    for (int line = lines.begin(); line < lines.end(); ++line) {
      Complex* at = data.data() + static_cast<std::size_t>(line) * between;
      for (int i = 0; i < length; ++i) in[i] = at[static_cast<std::size_t>(i) * stride];
      if (forward)
        fft.fwd(out, in);
      else
        fft.inv(out, in);
      for (int i = 0; i < length; ++i) at[static_cast<std::size_t>(i) * stride] = out[i];
    }
  });
}

}  // namespace

double diffraction_mtf(double cycles_per_mm, double lambda_nm, double working_fnumber) {
  const double x = std::abs(cycles_per_mm) * lambda_nm * 1e-6 * working_fnumber;
  return x >= 1 ? 0.0 : 2 / std::numbers::pi * (std::acos(x) - x * std::sqrt(1 - x * x));
}

double airy_radius_mm(double lambda_nm, double working_fnumber) { return 1.21967 * lambda_nm * 1e-6 * working_fnumber; }

void diffract(std::span<float> pixels, int width, int height, double pixel_pitch_mm, double lambda_nm,
              double working_fnumber) {
  if (width < 1 || height < 1 || pixels.size() != static_cast<std::size_t>(width) * height)
    throw std::invalid_argument("diffract: the picture is not width x height");
  // The pattern falls as 1/r^3: 16 Airy radii contain 99 % of the light; mirroring covers the rest.
  const int margin = static_cast<int>(std::ceil(16 * airy_radius_mm(lambda_nm, working_fnumber) / pixel_pitch_mm)) + 8;
  const int w = fast_length(width + 2 * margin), h = fast_length(height + 2 * margin);
  std::vector<Complex> field(static_cast<std::size_t>(w) * h);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
      field[static_cast<std::size_t>(y) * w + x] =
          pixels[static_cast<std::size_t>(mirrored(y - margin, height)) * width + mirrored(x - margin, width)];

  transform(field, h, w, w, 1, true);
  transform(field, w, h, 1, w, true);
  const auto frequency = [&](int i, int n) { return (i <= n / 2 ? i : i - n) / (n * pixel_pitch_mm); };
  tbb::parallel_for(0, h, [&](int y) {
    for (int x = 0; x < w; ++x)
      field[static_cast<std::size_t>(y) * w + x] *=
          diffraction_mtf(std::hypot(frequency(x, w), frequency(y, h)), lambda_nm, working_fnumber);
  });
  transform(field, w, h, 1, w, false);
  transform(field, h, w, w, 1, false);
  // Rounding and the cut-off at the pixel grid's frequency may give small negative values; irradiance is not negative.
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      pixels[static_cast<std::size_t>(y) * width + x] =
          static_cast<float>(std::max(0.0, field[static_cast<std::size_t>(y + margin) * w + x + margin].real()));
}

}  // namespace pecs::lens
