#pragma once
// From light to photocurrent: i_p = e/(hc) * area * fill factor * integral of lambda QE(lambda) E(lambda) dlambda
// (Eq. 5 in absolute units), a sum over the stack's bands with their quadrature weights (Eq. 6).
#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "pecs/sensor/chip.h"
#include "pecs/sensor/source.h"

namespace pecs::sensor {

struct PhotocurrentOptions {
  std::optional<double> fnumber;         // of the lens, for radiance: E = pi L / (4 N^2); default: the stack's
  std::optional<double> gain;            // for relative units: amperes = gain * lambda_nm * QE * weight_nm, Eq. 6's C
  std::optional<double> photocurrent_a;  // of relative light 1 in all bands
};
inline constexpr double kDefaultWhite_a = 1e-12;

// Throws usage for an option that has no effect on light of this quantity, or with another option.
void check_effect(const PhotocurrentOptions& options, Quantity quantity);

// Amperes in a pixel of the chip, without its mosaic, per unit of each band's value. The pixel's area is the chip's: a
// stack of coarser pixels (a quick render) gives each of them the light of one real pixel. Throws bad_input for
// radiance with neither f-number nor gain, and if the QE is 0 in all bands, and as check_effect; `name`: of the stack
// in such errors.
std::vector<double> amperes_per_unit(const Chip& chip, const StackInfo& stack, const PhotocurrentOptions& options,
                                     const std::string& name = "stack");

// Amperes per unit of each band's value, by the filters of the chip's mosaic; without one, alike for all pixels.
struct Response {
  Response(std::vector<double> amperes) : of_filter{std::move(amperes)} {}
  // amperes: without the mosaic. A filter's transmittance in a band is that at the band's wavelength. Throws bad_input
  // if a filter passes none of the bands; `name`: of the stack in that error.
  Response(const Chip& chip, const StackInfo& stack, const std::vector<double>& amperes,
           const std::string& name = "stack");
  std::vector<std::vector<double>> of_filter;
  std::shared_ptr<const Mosaic> mosaic;
};

// Rows [begin, end) of the planes of the filters, each pixel from that of its filter. `out` and the planes begin with
// row `begin`.
void pick_filters(const Mosaic& mosaic, std::span<const float* const> planes, int width, int begin, int end,
                  float* out);

// Monte Carlo instead of the sum over all bands (Eq. 8-11): draws `n` bands, each with a probability proportional to
// its share in the mean light (`mean_light` by band), and weights them by its inverse. All pixels share the drawn
// bands; the other bands get 0.
std::vector<double> monte_carlo(const std::vector<double>& amperes, const std::vector<double>& mean_light, int n,
                                std::uint64_t seed);
// The same with the light of the source's first frame, and the error: RMS over its pixels of ln of the ratio to the sum
// over all bands, with the mean ratio removed.
struct DrawnBands {
  std::vector<double> amperes;
  double rms_error_of_ln = 0;
};
DrawnBands draw_bands(const FrameSource& source, const std::vector<double>& amperes, int n, std::uint64_t seed);

// Reads planes of photocurrent [fA], without dark current. Thread-safe.
class PhotocurrentReader {
 public:
  // noise: read_fine() and read_between() return light * exp(noise * n), where n is the source's noise. The source must
  // outlive the reader.
  PhotocurrentReader(const FrameSource& source, const Response& response, double noise = 0);
  const FrameSource& source() const { return source_; }
  const StackInfo& info() const { return source_.info(); }
  // Rows [begin, end) of a frame into plane: [(end - begin) * width]. Values that are not finite become NaN (a pixel
  // keeps its last value there); negative light becomes 0.
  void read(std::int64_t frame, int begin, int end, float* plane);
  // The whole frame behind one filter, with its subpixels: [height * subpixels * width * subpixels].
  void read_fine(std::int64_t frame, std::size_t filter, float* plane);
  // A picture within the interval that begins at a frame, with its subpixels; NaN where it was not rendered.
  void read_between(std::int64_t frame, std::size_t which, std::size_t filter, float* plane);
  std::size_t filters() const { return femtoamperes_.size(); }
  const Mosaic* mosaic() const { return mosaic_.get(); }   // none: one filter
  std::int64_t not_finite() const { return not_finite_; }  // values so far, by pixel and frame
  std::int64_t negative() const { return negative_; }

 private:
  RowSink sums(std::size_t filter, float* plane, bool has_holes = false);
  RowSink disturbance(float* plane) const;
  struct Bad {
    std::int64_t not_finite = 0, negative = 0;
  };
  // Bad values of the bands become NaN or 0 or more in out: [n].
  Bad mend(std::span<const float> values, std::size_t n, float* out) const;

  const FrameSource& source_;
  std::vector<std::vector<float>> femtoamperes_;  // [filter][band]
  std::shared_ptr<const Mosaic> mosaic_;
  float noise_;
  std::atomic<std::int64_t> not_finite_{0}, negative_{0};
};

// Quantile of the finite values; 0 without any.
float quantile(std::vector<float> values, double part);

}  // namespace pecs::sensor
