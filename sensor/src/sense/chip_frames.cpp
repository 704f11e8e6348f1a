#include "sense/chip_frames.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "pecs/sensor/random.h"

namespace pecs::sensor {
namespace {

constexpr double kElectron_c = 1.602176634e-19;
constexpr double kElectronsPerFaUs = 1e-21 / kElectron_c;

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
      exposure_us_(chip.frame_exposure_s * 1e6),
      row_us_(chip.frame_row_s * 1e6) {}

void ChipFrames::add(std::span<const float* const> planes, std::span<const double> t_us, Region rows) {
  const std::size_t first = static_cast<std::size_t>(rows.begin) * width_,
                    pixels = static_cast<std::size_t>(rows.end) * width_ - first;
  if (rows_.begin != rows.begin || rows_.end != rows.end) last_plane_.clear();
  rows_ = rows;
  for (std::size_t i = 0; i < planes.size(); ++i) {
    if (i > 0)
      expose(planes[i - 1], planes[i], t_us[i - 1], t_us[i]);
    else if (!last_plane_.empty())
      expose(last_plane_.data() - first, planes[i], last_us_, t_us[i]);
  }
  if (planes.empty()) return;
  last_plane_.assign(planes.back() + first, planes.back() + first + pixels);
  last_us_ = t_us.back();
}

// Adds the light between two planes to each frame that is exposed then.
void ChipFrames::expose(const float* from, const float* to, double from_us, double to_us) {
  const double rolled_us = row_us_ * static_cast<double>(height_ - 1), length_us = to_us - from_us;
  const double earliest_us = std::max(from_us - exposure_us_ - rolled_us, from_us_);
  for (auto k = std::max<std::int64_t>(0, std::llround(std::ceil(earliest_us / period_us_))); begin_us(k) < to_us;
       ++k) {
    if (begin_us(k) + rolled_us + exposure_us_ > to_us_) break;
    if (begin_us(k) + rolled_us + exposure_us_ <= from_us) continue;  // complete, and perhaps taken
    const auto found = light_.try_emplace(k, width_ * height_).first;
    tbb::parallel_for(rows_.begin, rows_.end, [&](int y) {
      const double row_begin_us = begin_us(k) + row_us_ * y;
      const double a = (std::max(row_begin_us, from_us) - from_us) / length_us,
                   b = (std::min(row_begin_us + exposure_us_, to_us) - from_us) / length_us;
      if (a >= b) return;
      // Integral of linear light from a to b, as weights of its ends.
      const double of_to = 0.5 * (b - a) * (a + b) * length_us, of_from = (b - a) * length_us - of_to;
      const std::size_t first = static_cast<std::size_t>(y) * width_;
      for (std::size_t p = first; p < first + width_; ++p) found->second[p] += of_from * from[p] + of_to * to[p];
    });
  }
}

std::vector<events::Frame> ChipFrames::take() {
  const double rolled_us = row_us_ * static_cast<double>(height_ - 1);
  std::vector<events::Frame> out;
  while (!light_.empty()) {
    const auto first = light_.begin();
    if (begin_us(first->first) + rolled_us + exposure_us_ > last_us_ || rows_.end < static_cast<int>(height_)) break;
    out.push_back(developed(first->first, first->second));
    light_.erase(first);
    ++frames_;
    for (const std::uint16_t dn : out.back().values) {
      sum_ += dn;
      saturated_ += dn == (1u << out.back().bits) - 1;
    }
  }
  return out;
}

// Light, dark current and shot noise in electrons; gain, offset, read noise and the ADC.
events::Frame ChipFrames::developed(std::int64_t frame, std::span<const double> light) const {
  events::Frame out;
  const double begin_us_of_middle = begin_us(frame) - from_us_ + row_us_ * 0.5 * static_cast<double>(height_ - 1);
  out.begin_us = std::llround(begin_us_of_middle);
  out.end_us = std::llround(begin_us_of_middle + exposure_us_);
  out.bits = static_cast<int>(chip_.frame_adc_bits);
  out.values.resize(light.size());
  const double most = std::exp2(chip_.frame_adc_bits) - 1;
  const double dark_e = exposure_us_ * (chip_.dark_current_a * 1e15 * kElectronsPerFaUs + chip_.frame_dark_hz * 1e-6);
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
      // Light that is not finite is counted in bad_values.
      out.values[p] = std::isfinite(dn) ? static_cast<std::uint16_t>(std::lround(std::clamp(dn, 0.0, most))) : 0;
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
  return {fmt::format("--frames: {:.0f} % of the values are saturated; --set frame_exposure_s={} is shorter",
                      100 * share, chip_.frame_exposure_s / 4)};
}

}  // namespace pecs::sensor
