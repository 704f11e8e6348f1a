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

using Fft = Eigen::FFT<double>;

// Calls use(fft, first, end) for blocks of `count` lines, in parallel.
template <class Use>
void for_lines(int count, const Use& use) {
  tbb::parallel_for(tbb::blocked_range<int>(0, count, 16), [&](const tbb::blocked_range<int>& lines) {
    Fft fft(Fft::impl_type(), Fft::HalfSpectrum);
    use(fft, lines.begin(), lines.end());
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
  const int w = fast_length(width + 2 * margin), h = fast_length(height + 2 * margin), half = w / 2 + 1;
  // Rounding and the cut-off at the pixel grid's frequency may give small negative values; irradiance is not negative.
  const bool irradiance = std::ranges::all_of(pixels, [](float v) { return v >= 0; });
  std::vector<Complex> field(static_cast<std::size_t>(half) * h);  // column by column
  for_lines(h, [&](Fft& fft, int first, int end) {
    std::vector<double> line(w);
    std::vector<Complex> spectrum;
    for (int y = first; y < end; ++y) {
      const float* row = pixels.data() + static_cast<std::size_t>(mirrored(y - margin, height)) * width;
      for (int x = 0; x < w; ++x) line[x] = row[mirrored(x - margin, width)];
      fft.fwd(spectrum, line);
      for (int x = 0; x < half; ++x) field[static_cast<std::size_t>(x) * h + y] = spectrum[x];
    }
  });
  const auto frequency = [&](int i, int n) { return std::min(i, n - i) / (n * pixel_pitch_mm); };
  for_lines(half, [&](Fft& fft, int first, int end) {
    std::vector<Complex> spectrum(h);
    for (int x = first; x < end; ++x) {
      Complex* column = field.data() + static_cast<std::size_t>(x) * h;
      fft.fwd(spectrum.data(), column, h);
      for (int y = 0; y < h; ++y)
        spectrum[y] *= diffraction_mtf(std::hypot(frequency(x, w), frequency(y, h)), lambda_nm, working_fnumber);
      fft.inv(column, spectrum.data(), h);
    }
  });
  for_lines(height, [&](Fft& fft, int first, int end) {
    std::vector<double> line(w);
    std::vector<Complex> spectrum(half);
    for (int y = first; y < end; ++y) {
      for (int x = 0; x < half; ++x) spectrum[x] = field[static_cast<std::size_t>(x) * h + y + margin];
      fft.inv(line.data(), spectrum.data(), w);
      float* row = pixels.data() + static_cast<std::size_t>(y) * width;
      for (int x = 0; x < width; ++x)
        row[x] = static_cast<float>(irradiance ? std::max(0.0, line[x + margin]) : line[x + margin]);
    }
  });
}

}  // namespace pecs::lens
