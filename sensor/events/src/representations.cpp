#include "pecs/events/representations.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "pecs/error.h"

namespace pecs::events {
namespace {

constexpr int kMostBins = 4096;

// Checks the arguments, and holds the values that the loops need.
struct Planes {
  Planes(const EventWindow& window, int planes, std::span<const float> out)
      : width(static_cast<std::uint32_t>(window.width)),
        height(static_cast<std::uint32_t>(window.height)),
        size(std::size_t{width} * height),
        begin_us(window.begin_us),
        length_us(window.end_us - window.begin_us) {
    constexpr int kMostSide = 1 << 16;
    for (const int side : {window.width, window.height})
      if (side < 1 || side > kMostSide)
        throw bad_usage("size", fmt::format("{}x{}", window.width, window.height),
                        fmt::format("1 to {} each", kMostSide));
    if (planes < 1 || planes > 2 * kMostBins)
      throw bad_usage("bins", fmt::format("{}", planes), fmt::format("1 to {}", kMostBins));
    if (!(length_us >= 0 && std::isfinite(length_us)))
      throw bad_usage("window", fmt::format("{} to {} us", window.begin_us, window.end_us),
                      "a begin and an end behind it");
    if (out.size() != size * static_cast<std::size_t>(planes))
      throw bad_usage("out", fmt::format("{} values", out.size()), fmt::format("{} x {} x {}", planes, height, width));
    const auto whole = [](double t_us) {
      constexpr double kMost = 9e18;  // of an int64
      return static_cast<std::int64_t>(std::clamp(t_us, -kMost, kMost));
    };
    first_us = whole(std::ceil(window.begin_us)), last_us = whole(std::floor(window.end_us));
  }
  bool holds(const Event& e) const { return e.t_us >= first_us && e.t_us <= last_us; }
  std::size_t pixel(const Event& e) const {
    if (e.x >= width || e.y >= height) [[unlikely]]
      throw bad_input("events", "pixel", fmt::format("({}, {})", e.x, e.y), fmt::format("one of {}x{}", width, height));
    return std::size_t{e.y} * width + e.x;
  }
  double since_us(const Event& e) const { return static_cast<double>(e.t_us) - begin_us; }

  std::uint32_t width, height;
  std::size_t size;
  double begin_us, length_us;
  std::int64_t first_us = 0, last_us = 0;
};

// 0 for 0, otherwise 1; branchless.
float is_some(float v) { return static_cast<float>(std::bit_cast<std::uint32_t>(v) << 1 != 0); }

// Like E2VID's EventPreprocessor.
void normalise_values(std::span<float> values) {
  // Sums short runs in float, in lanes for vectorisation, and the results in double.
  constexpr std::size_t kLanes = 64, kRun = 64 * kLanes;
  double sum = 0, squares = 0, count = 0;
  for (std::size_t begin = 0; begin < values.size(); begin += kRun) {
    float sums[kLanes] = {}, of_squares[kLanes] = {}, counts[kLanes] = {};
    for (std::size_t at = begin; at < std::min(begin + kRun, values.size()); at += kLanes) {
      const float* v = values.data() + at;
      for (std::size_t k = 0; k < std::min(kLanes, values.size() - at); ++k) {
        sums[k] += v[k];
        of_squares[k] += v[k] * v[k];
        counts[k] += is_some(v[k]);
      }
    }
    for (std::size_t k = 0; k < kLanes; ++k) sum += sums[k], squares += of_squares[k], count += counts[k];
  }
  if (count == 0) return;
  const double mean = sum / count, variance = squares / count - mean * mean;
  const double least = 1e-6 * squares / count;  // rounding error of a variance of 0
  const double scale = variance > least ? 1 / std::sqrt(variance) : 1;
  const auto times = static_cast<float>(scale), less = static_cast<float>(mean * scale);
  for (float& v : values) v = v * times - less * is_some(v);
}

}  // namespace

void voxel_grid(std::span<const Event> events, const EventWindow& window, int bins, bool normalise,
                std::span<float> out) {
  const Planes planes(window, bins, out);
  std::ranges::fill(out, 0.0f);
  const double per_us = planes.length_us > 0 ? (bins - 1) / planes.length_us : 0;
  for (const Event& e : events) {
    if (!planes.holds(e)) continue;
    const double at = planes.since_us(e) * per_us;
    const int bin = std::min(static_cast<int>(at), bins - 1);
    const float right = static_cast<float>(at - bin), sign = e.p ? 1.0f : -1.0f;
    float* cell = out.data() + static_cast<std::size_t>(bin) * planes.size + planes.pixel(e);
    cell[0] += sign * (1 - right);
    if (bin + 1 < bins) cell[planes.size] += sign * right;
  }
  if (normalise) normalise_values(out);
}

void time_surface(std::span<const Event> events, const EventWindow& window, double tau_us, std::span<float> out) {
  if (!(tau_us > 0)) throw Error(ExitCode::usage, fmt::format("tau_us: got {}, wanted more than 0", tau_us));
  const Planes planes(window, 2, out);
  // First the last times, then their decay.
  constexpr float kNever = -std::numeric_limits<float>::infinity();
  std::ranges::fill(out, kNever);
  for (const Event& e : events) {
    if (!planes.holds(e)) continue;
    float& last = out[(e.p ? planes.size : 0) + planes.pixel(e)];
    last = std::max(last, static_cast<float>(static_cast<double>(e.t_us) - window.end_us));
  }
  const auto per_us = static_cast<float>(1 / tau_us);
  for (float& v : out) v = v == kNever ? 0.0f : std::exp(v * per_us);
}

void event_histogram(std::span<const Event> events, const EventWindow& window, int bins, std::span<float> out) {
  const Planes planes(window, bins < 1 || bins > kMostBins ? 0 : 2 * bins, out);
  std::ranges::fill(out, 0.0f);
  const double per_us = planes.length_us > 0 ? bins / planes.length_us : 0;
  for (const Event& e : events) {
    if (!planes.holds(e)) continue;
    const int bin = std::min(static_cast<int>(planes.since_us(e) * per_us), bins - 1) + (e.p ? bins : 0);
    out[static_cast<std::size_t>(bin) * planes.size + planes.pixel(e)] += 1;
  }
}

}  // namespace pecs::events
