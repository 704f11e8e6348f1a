#include "pecs/sensor/photocurrent.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "light/float_math.h"
#include "pecs/error.h"
#include "pecs/sensor/random.h"
#include "stack/light_kernel.h"

namespace pecs::sensor {

void check_effect(const PhotocurrentOptions& options, Quantity quantity) {
  const std::string got = fmt::format("light in {} units", name_of(quantity));
  if (options.gain && options.fnumber) throw bad_usage("--fnumber", "--gain as well", "one of them");
  if (options.gain && options.photocurrent_a) throw bad_usage("--photocurrent", "--gain as well", "one of them");
  if (options.fnumber && quantity != Quantity::radiance) throw bad_usage("--fnumber", got, "radiance");
  if (options.photocurrent_a && quantity != Quantity::relative)
    throw bad_usage("--photocurrent", got, "relative light, or --gain");
}

std::vector<double> amperes_per_unit(const Chip& chip, const StackInfo& stack, const PhotocurrentOptions& options,
                                     const std::string& name) {
  check_effect(options, stack.quantity);
  constexpr double kElectron_c = 1.602176634e-19, kPlanck_js = 6.62607015e-34, kLight_m_per_s = 299792458;
  const bool absolute = stack.quantity != Quantity::relative && !options.gain;
  double film_per_value = 1;
  if (stack.quantity == Quantity::radiance && absolute) {
    const std::optional<double> fnumber = options.fnumber ? options.fnumber : stack.fnumber;
    if (!fnumber) throw bad_input(name, "quantity", "radiance without --fnumber", "the lens's f-number, or --gain");
    film_per_value = std::numbers::pi / (4 * *fnumber * *fnumber);
  }
  const double area_m2 = chip.pixel_pitch_m * chip.pixel_pitch_m * chip.fill_factor;
  std::vector<double> weights;
  double total = 0;
  for (const Band& band : stack.bands) {
    const double relative = band.lambda_nm * chip.relative_qe.at(band.lambda_nm);
    const double amperes_per_watt =  // Eq. 3 solved for R
        chip.peak_qe * relative * 1e-9 * kElectron_c / (kPlanck_js * kLight_m_per_s);
    weights.push_back((absolute ? film_per_value * area_m2 * amperes_per_watt : relative) * band.weight_nm);
    total += weights.back();
  }
  if (!(total > 0)) throw bad_input(name, "bands", "no band within the chip's spectral range", "at least one");
  if (!absolute) {
    const double scale = options.gain ? *options.gain : options.photocurrent_a.value_or(kDefaultWhite_a) / total;
    for (double& w : weights) w *= scale;
  }
  return weights;
}

Response::Response(const Chip& chip, const StackInfo& stack, const std::vector<double>& amperes,
                   const std::string& name)
    : mosaic(chip.mosaic) {
  if (!mosaic) {
    of_filter = {amperes};
    return;
  }
  for (const Mosaic::Filter& filter : mosaic->filters) {
    std::vector<double> passed;
    for (std::size_t b = 0; b < amperes.size(); ++b)
      passed.push_back(amperes[b] * filter.transmittance.at(stack.bands[b].lambda_nm));
    if (std::ranges::none_of(passed, [](double a) { return a > 0; }))
      throw bad_input(name, "bands", fmt::format("none that filter {} of {} passes", filter.name, chip.name),
                      "light for each of the mosaic's filters");
    of_filter.push_back(std::move(passed));
  }
}

void pick_filters(const Mosaic& mosaic, std::span<const float* const> planes, int width, int begin, int end,
                  float* out) {
  const auto columns = static_cast<std::size_t>(width);
  for (auto y = static_cast<std::size_t>(begin); y < static_cast<std::size_t>(end); ++y) {
    const std::size_t row = (y - static_cast<std::size_t>(begin)) * columns;
    for (std::size_t x = 0; x < columns; ++x) out[row + x] = planes[mosaic.of(x, y)][row + x];
  }
}

std::vector<double> monte_carlo(const std::vector<double>& amperes, const std::vector<double>& mean_light, int n,
                                std::uint64_t seed) {
  std::vector<double> share;  // cumulated
  double total = 0;
  for (std::size_t b = 0; b < amperes.size(); ++b) share.push_back(total += amperes[b] * std::max(0.0, mean_light[b]));
  if (!(total > 0)) throw bad_input("stack", "first frame", "no light", "light to draw bands by");
  std::vector<double> weights(amperes.size());
  for (int k = 0; k < n; ++k) {
    const double u = total * uniform(random4(seed, static_cast<std::uint32_t>(k), 0, Purpose::bands)[0]);
    const auto b = static_cast<std::size_t>(std::ranges::upper_bound(share, u) - share.begin());
    const double p = amperes[b] * mean_light[b] / total;  // Eq. 10
    weights[b] += amperes[b] / (n * p);                   // Eq. 11
  }
  return weights;
}

namespace {

// The first frame's spectra: [band][pixel]; 0 for values that are negative or not finite.
struct FirstFrame {
  explicit FirstFrame(const FrameSource& source)
      : mean(source.info().bands.size()),
        values(whole_frame(mean.size(), source.info().width, source.info().height,
                           [&](const RowSink& sink) { source.read_rows(0, sink); })),
        pixels(values.size() / mean.size()) {
    for (std::size_t k = 0; k < values.size(); ++k) {
      if (!(std::isfinite(values[k]) && values[k] > 0)) values[k] = 0;
      mean[k / pixels] += values[k];
    }
    for (double& m : mean) m /= static_cast<double>(pixels);
  }
  // RMS over the pixels of ln of the ratio of two weighted sums, with the mean ratio removed.
  double log_difference(const std::vector<double>& a, const std::vector<double>& b) const {
    double n = 0, sum = 0, square = 0;
    for (std::size_t i = 0; i < pixels; ++i) {
      double x = 0, y = 0;
      for (std::size_t k = 0; k < mean.size(); ++k) {
        x += a[k] * values[k * pixels + i];
        y += b[k] * values[k * pixels + i];
      }
      if (!(x > 0 && y > 0)) continue;
      const double d = std::log(x / y);
      n += 1;
      sum += d;
      square += d * d;
    }
    return n > 0 ? std::sqrt(std::max(0.0, square / n - sum / n * (sum / n))) : 0;
  }
  std::vector<double> mean;
  std::vector<float> values;
  std::size_t pixels;
};

}  // namespace

DrawnBands draw_bands(const FrameSource& source, const std::vector<double>& amperes, int n, std::uint64_t seed) {
  const FirstFrame first(source);
  const std::vector<double> drawn = monte_carlo(amperes, first.mean, n, seed);
  return {drawn, first.log_difference(drawn, amperes)};
}

PhotocurrentReader::PhotocurrentReader(const FrameSource& source, const Response& response, double noise)
    : source_(source), mosaic_(response.mosaic), noise_(static_cast<float>(noise)) {
  for (const std::vector<double>& amperes : response.of_filter) {
    std::vector<float>& of_bands = femtoamperes_.emplace_back();
    for (const double a : amperes) of_bands.push_back(static_cast<float>(a * 1e15));
  }
}

void PhotocurrentReader::read(std::int64_t frame, int begin, int end, float* plane) {
  const auto width = static_cast<std::size_t>(info().width);
  const RowSink sum = [&](int y, int rows, std::span<const float> values) {
    const std::size_t n = width * static_cast<std::size_t>(rows);
    float* out = plane + static_cast<std::size_t>(y - begin) * width;
    bool has_bad = false;
    if (mosaic_) {
      std::vector<float> passed(filters() * n);
      std::vector<const float*> planes;
      for (std::size_t k = 0; k < filters(); ++k) {
        has_bad |= weighted_sum(femtoamperes_[k], values.data(), std::span(passed).subspan(k * n, n));
        planes.push_back(passed.data() + k * n);
      }
      pick_filters(*mosaic_, planes, info().width, y, y + rows, out);
    } else {
      has_bad = weighted_sum(femtoamperes_[0], values.data(), {out, n});
    }
    if (!has_bad) return;
    const Bad bad = mend(values, n, out);
    not_finite_ += bad.not_finite;
    negative_ += bad.negative;
  };
  source_.read_rows(frame, sum, begin, end);
}

void PhotocurrentReader::read_fine(std::int64_t frame, std::size_t filter, float* plane) {
  source_.read_fine_rows(frame, sums(filter, plane));
  if (noise_ != 0) source_.read_noise(frame, disturbance(plane));
}

void PhotocurrentReader::read_between(std::int64_t frame, std::size_t which, std::size_t filter, float* plane) {
  source_.read_between(frame, which, sums(filter, plane, true));
  if (noise_ != 0) source_.read_between_noise(frame, which, disturbance(plane));
}

RowSink PhotocurrentReader::disturbance(float* plane) const {
  return [this, plane](int y, int, std::span<const float> noise) {
    float* out = plane + static_cast<std::size_t>(y) * static_cast<std::size_t>(info().file_width());
    for (std::size_t i = 0; i < noise.size(); ++i)
      if (std::isfinite(noise[i])) out[i] *= exp_of(noise_ * noise[i]);
  };
}

// Sums the subpixels of a whole frame. has_holes: values that are not finite were not rendered.
RowSink PhotocurrentReader::sums(std::size_t filter, float* plane, bool has_holes) {
  return [=, this](int y, int rows, std::span<const float> values) {
    const auto columns = static_cast<std::size_t>(info().file_width());
    const std::size_t n = columns * static_cast<std::size_t>(rows);
    float* out = plane + static_cast<std::size_t>(y) * columns;
    if (!weighted_sum(femtoamperes_[filter], values.data(), {out, n})) return;
    const Bad bad = mend(values, n, out);
    if (filter > 0) return;  // counted with the first
    negative_ += bad.negative;
    if (!has_holes) not_finite_ += bad.not_finite;
  };
}

PhotocurrentReader::Bad PhotocurrentReader::mend(std::span<const float> values, std::size_t n, float* out) const {
  Bad bad;
  for (std::size_t i = 0; i < n; ++i) {
    bool negative = false, not_finite = false;
    for (std::size_t b = 0; b < femtoamperes_[0].size(); ++b) {
      negative |= values[b * n + i] < 0;
      not_finite |= !std::isfinite(values[b * n + i]);
    }
    if (not_finite) {
      out[i] = std::numeric_limits<float>::quiet_NaN();
      ++bad.not_finite;
    } else if (negative) {
      out[i] = std::max(out[i], 0.0f);
      ++bad.negative;
    }
  }
  return bad;
}

float quantile(std::vector<float> values, double part) {
  std::erase_if(values, [](float v) { return !std::isfinite(v); });
  if (values.empty()) return 0;
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(part * static_cast<double>(values.size() - 1));
  std::ranges::nth_element(values, at);
  return *at;
}

}  // namespace pecs::sensor
