#include "sense/chip_frames.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "pecs/sensor/random.h"

namespace pecs::sensor {
namespace {

constexpr double kElectron_c = 1.602176634e-19;
constexpr double kElectronsPerFaUs = 1e-21 / kElectron_c;
constexpr double kLeastAuto_us = 10, kMostAuto_us = 25'000;  // davis_ros_driver
constexpr double kLeastLibcaer_us = 1;

// Mean of the values' middle half, as a share of the ADC's range.
double middle_mean(const events::Frame& frame) {
  std::vector<std::uint16_t> values = frame.values;
  const std::ptrdiff_t quarter = std::ssize(values) / 4, middle = std::ssize(values) - 2 * quarter;
  const auto first = values.begin() + quarter, end = first + middle;
  std::ranges::nth_element(values, first);
  std::ranges::nth_element(first, end, values.end());
  return std::accumulate(first, end, 0.0) / (std::exp2(frame.bits) - 1) / static_cast<double>(middle);
}

// libcaer (autoexposure.c): by the share of dark values, or of bright ones, where only one of them is a third or more;
// otherwise by the mean of five classes of values, weighted by the values, which is to be 2.5.
double libcaer_change_us(const events::Frame& frame) {
  constexpr double kMany = 0.33, kMost_us = 14'000, kExponent = 1.65, kFine_us = 100, kGoodEnough = 0.1;
  double low = 0, high = 0, sum = 0, classes = 0;
  for (const std::uint16_t value : frame.values) {
    const double share = value / std::exp2(frame.bits);
    low += std::floor(256 * share) < 25;
    high += std::floor(256 * share) >= 230;
    sum += value;
    classes += value * (1 + std::floor(5 * share));
  }
  const double above_low = low / static_cast<double>(frame.values.size()) - kMany,
               above_high = high / static_cast<double>(frame.values.size()) - kMany;
  double sign = 0, change_us = 0;
  if ((above_low < 0) != (above_high < 0)) {
    sign = above_high < 0 ? 1 : -1;
    change_us = kMost_us * std::pow(std::max(above_low, above_high), kExponent);
  } else if (const double missing = 2.5 - classes / std::max(sum, 1.0); std::abs(missing) > kGoodEnough) {
    const double near = std::min(std::abs(above_low), std::abs(above_high));  // smaller steps do not oscillate
    sign = missing > 0 ? 1 : -1;
    change_us = std::floor(kFine_us * missing * missing) / (near < 0.05 ? 10 : near < 0.1 ? 5 : 1);
  }
  return sign * std::max(1.0, std::floor(change_us));
}

}  // namespace

ChipFrames::ChipFrames(const Chip& chip, int width, int height, double unit_fa, std::optional<std::uint64_t> seed,
                       std::int64_t from_us, std::int64_t to_us)
    : chip_(chip),
      width_(static_cast<std::size_t>(width)),
      height_(static_cast<std::size_t>(height)),
      unit_fa_(unit_fa),
      seed_(seed),
      from_us_(static_cast<double>(from_us)),
      to_us_(static_cast<double>(to_us)),
      period_us_(chip.frame_period_s * 1e6),
      row_us_(chip.frame_row_s * 1e6),
      rolled_us_(row_us_ * (height - 1)),
      exposures_us_{chip.frame_exposure_s * 1e6},
      libcaer_(chip.frame_auto_libcaer > 0),
      most_us_(std::min(libcaer_ ? period_us_ : kMostAuto_us, period_us_ - chip.frame_dead_s * 1e6)) {}

void ChipFrames::add(std::span<const float* const> planes, std::span<const double> t_us, Region rows) {
  const std::size_t first = static_cast<std::size_t>(rows.begin) * width_,
                    pixels = static_cast<std::size_t>(rows.end) * width_ - first;
  if (rows_.begin != rows.begin || rows_.end != rows.end) last_plane_.clear();
  rows_ = rows;
  for (std::size_t i = 0; i < planes.size(); ++i) {
    const bool is_first = last_plane_.empty();
    last_plane_.resize(pixels);
    plane_.resize(pixels);
    // As for the events: values that are not finite are the pixel's last light, negative ones are dark.
    std::transform(planes[i] + first, planes[i] + first + pixels, last_plane_.begin(), plane_.begin(),
                   [](float now, float last) { return std::isfinite(now) ? std::max(now, 0.0f) : last; });
    if (!is_first) expose(last_plane_.data() - first, plane_.data() - first, last_us_, t_us[i]);
    std::swap(last_plane_, plane_);
    last_us_ = t_us[i];
  }
}

// Adds the light between two planes to each frame that is exposed then.
void ChipFrames::expose(const float* from, const float* to, double from_us, double to_us) {
  const double length_us = to_us - from_us;
  for (std::int64_t k = first_frame(from_us); begin_us(k) < to_us; ++k) {
    if (end_us(k) <= from_us || !(is_output(k) || chip_.has_auto_exposure())) continue;
    std::vector<double>& light = light_.try_emplace(k, width_ * height_).first->second;
    const double exposed_us = exposure_us(k);
    tbb::parallel_for(rows_.begin, rows_.end, [&](int y) {
      const double row_begin_us = begin_us(k) + row_us_ * y;
      const double a = (std::max(row_begin_us, from_us) - from_us) / length_us,
                   b = (std::min(row_begin_us + exposed_us, to_us) - from_us) / length_us;
      if (a >= b) return;
      // Integral of linear light from a to b, as weights of its ends.
      const double of_to = 0.5 * (b - a) * (a + b) * length_us, of_from = (b - a) * length_us - of_to;
      const std::size_t first = static_cast<std::size_t>(y) * width_;
      for (std::size_t p = first; p < first + width_; ++p) light[p] += of_from * from[p] + of_to * to[p];
    });
    if (end_us(k) <= to_us && rows_.end == static_cast<int>(height_)) complete(k);
  }
}

void ChipFrames::complete(std::int64_t frame) {
  events::Frame out = developed(frame, light_.at(frame));
  light_.erase(frame);
  if (chip_.has_auto_exposure()) {
    const double factor = libcaer_ ? 1 : 1 + chip_.frame_auto_gain * (chip_.frame_auto_mean - middle_mean(out));
    metered_.push_back({end_us(frame), exposure_us(frame), factor, libcaer_ ? libcaer_change_us(out) : 0});
  }
  if (!is_output(frame)) return;
  ++frames_;
  for (const std::uint16_t dn : out.values) {
    sum_ += dn;
    saturated_ += dn == (1u << out.bits) - 1;
  }
  complete_.push_back(std::move(out));
}

// The frame begins in the light so far. Frames that ended before it set its exposure.
double ChipFrames::exposure_us(std::int64_t frame) {
  if (!chip_.has_auto_exposure()) return exposures_us_.front();
  while (std::ssize(exposures_us_) <= frame) {
    double next_us = exposures_us_.back();
    for (; !metered_.empty() && metered_.front().end_us <= begin_us(std::ssize(exposures_us_)); metered_.pop_front()) {
      const auto& [of_end_us, of_us, factor, add_us] = metered_.front();
      if (libcaer_ && of_us != next_us) continue;  // it waits for its last change
      next_us =
          std::clamp(std::round(next_us * factor + add_us), libcaer_ ? kLeastLibcaer_us : kLeastAuto_us, most_us_);
    }
    exposures_us_.push_back(next_us);
  }
  return exposures_us_[static_cast<std::size_t>(frame)];
}

std::int64_t ChipFrames::first_frame(double us) const {
  const double longest_us = std::max(exposures_us_.front(), most_us_) + rolled_us_;
  return std::max<std::int64_t>(0, std::llround(std::floor((us - longest_us) / period_us_)));
}

std::vector<ChipExposure> ChipFrames::exposures(double from_us, double to_us) {
  std::vector<ChipExposure> out;
  for (std::int64_t k = first_frame(from_us); begin_us(k) < to_us; ++k)
    if (end_us(k) >= from_us) out.push_back({k, begin_us(k), begin_us(k) + exposure_us(k)});
  return out;
}

// Light, dark current and shot noise in electrons; gain, offset, read noise and the ADC.
events::Frame ChipFrames::developed(std::int64_t frame, std::span<const double> light) {
  events::Frame out;
  const double begin_us_of_middle = begin_us(frame) - from_us_ + 0.5 * rolled_us_, exposed_us = exposure_us(frame);
  out.begin_us = std::llround(begin_us_of_middle);
  out.end_us = std::llround(begin_us_of_middle + exposed_us);
  out.bits = static_cast<int>(chip_.frame_adc_bits);
  out.values.resize(light.size());
  const double most = std::exp2(chip_.frame_adc_bits) - 1;
  const double dark_e = exposed_us * (chip_.dark_current_a * 1e15 * kElectronsPerFaUs + chip_.frame_dark_hz * 1e-6);
  tbb::parallel_for(std::size_t{0}, height_, [&](std::size_t y) {
    for (std::size_t p = y * width_; p < (y + 1) * width_; ++p) {
      const auto pixel = static_cast<std::uint32_t>(p);
      double electrons = light[p] * unit_fa_ * kElectronsPerFaUs + dark_e, dn = chip_.frame_offset_dn;
      if (seed_) {
        const Random4 fixed = random4(*seed_, pixel, -1, Purpose::frame),
                      r = random4(*seed_, pixel, frame, Purpose::frame);
        electrons *= std::max(0.0, 1 + chip_.frame_gain_mismatch * gaussian(fixed[0]));
        dn += chip_.frame_offset_mismatch_dn * gaussian(fixed[1]);
        electrons += std::hypot(std::sqrt(electrons), chip_.frame_read_noise_e) * gaussian(r[0]);
      }
      dn += electrons / chip_.frame_gain_e;
      out.values[p] = static_cast<std::uint16_t>(std::lround(std::clamp(dn, 0.0, most)));
    }
  });
  return out;
}

Json ChipFrames::report() const {
  const double values = static_cast<double>(frames_) * static_cast<double>(width_ * height_);
  return {{"frames", frames_},
          {"mean_dn", frames_ ? Json(sum_ / values) : Json()},
          {"saturated_share", frames_ ? Json(static_cast<double>(saturated_) / values) : Json()}};
}

std::vector<std::string> ChipFrames::warnings() const {
  constexpr double kMostSaturated = 0.05;
  const Json counts = report();
  if (!frames_) return {"--frames: no exposure lies within the output"};
  const auto share = counts["saturated_share"].get<double>();
  if (share <= kMostSaturated) return {};
  const std::string remedy = libcaer_ ? "libcaer's exposure allows a third"
                             : chip_.has_auto_exposure()
                                 ? fmt::format("--set frame_auto_mean={} exposes less", chip_.frame_auto_mean / 2)
                                 : fmt::format("--set frame_exposure_s={} is shorter", chip_.frame_exposure_s / 4);
  return {fmt::format("--frames: {:.0f} % of the values are saturated; {}", 100 * share, remedy)};
}

}  // namespace pecs::sensor
