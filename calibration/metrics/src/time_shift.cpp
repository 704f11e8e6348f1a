#include "pecs/metrics/time_shift.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <vector>

namespace pecs::metrics {
namespace {

constexpr int kColumns = 40, kTimeBins = 100;

// ON minus OFF events per block and time bin: [bin][block].
struct Volume {
  int blocks = 0, bins = 0;
  std::vector<float> value;
  std::span<const float> bin(int i) const {
    return std::span(value).subspan(static_cast<std::size_t>(i) * static_cast<std::size_t>(blocks),
                                    static_cast<std::size_t>(blocks));
  }
};

Volume volume_of(const events::Recording& recording, double bin_us) {
  const int size = std::max(1, recording.width / kColumns), columns = (recording.width + size - 1) / size;
  Volume v;
  v.blocks = columns * ((recording.height + size - 1) / size);
  v.bins = static_cast<int>(static_cast<double>(recording.span_us) / bin_us);  // complete bins only
  v.value.resize(static_cast<std::size_t>(v.blocks) * static_cast<std::size_t>(v.bins));
  for (const auto& e : recording.events) {
    const int bin = static_cast<int>(static_cast<double>(e.t_us) / bin_us);
    if (bin >= v.bins) break;
    const int block = e.y / size * columns + e.x / size;
    v.value[static_cast<std::size_t>(bin) * static_cast<std::size_t>(v.blocks) + static_cast<std::size_t>(block)] +=
        e.p ? 1.0F : -1.0F;
  }
  return v;
}

// Correlation over the common bins, with sim's bin i + shift at real's bin i.
std::optional<double> correlation(const Volume& real, const Volume& sim, int shift) {
  const int first = std::max(0, -shift), last = std::min(real.bins, sim.bins - shift);
  if (last - first < std::min(real.bins, sim.bins) / 4) return {};
  double product = 0, rr = 0, ss = 0;
  for (int i = first; i < last; ++i) {
    const auto a = real.bin(i), b = sim.bin(i + shift);
    for (std::size_t k = 0; k < a.size(); ++k) product += a[k] * b[k], rr += a[k] * a[k], ss += b[k] * b[k];
  }
  if (rr <= 0 || ss <= 0) return {};
  return product / std::sqrt(rr * ss);
}

}  // namespace

std::optional<TimeShift> time_shift(const events::Recording& real, const events::Recording& sim,
                                    std::int64_t range_us) {
  if (real.width != sim.width || real.height != sim.height) return {};
  const double bin_us = std::max(1.0, static_cast<double>(std::min(real.span_us, sim.span_us)) / kTimeBins);
  const Volume a = volume_of(real, bin_us), b = volume_of(sim, bin_us);
  const auto now = correlation(a, b, 0);
  if (!now || real.events.size() < 1000 || sim.events.size() < 1000) return {};

  // The best shift in whole bins.
  const int range = static_cast<int>(static_cast<double>(range_us) / bin_us);
  int best = 0;
  double top = *now;
  for (int shift = -range; shift <= range; ++shift)
    if (const auto c = correlation(a, b, shift); c && *c > top) top = *c, best = shift;

  // The maximum of a parabola, fitted to the bins about the peak that reach 70 % of it.
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const int direction : {-1, 1})
    for (int d = direction == 1 ? 0 : -1; std::abs(d) <= kTimeBins / 4; d += direction) {
      const auto c = correlation(a, b, best + d);
      if (!c || *c < 0.7 * top) break;
      const Eigen::Vector3d row(1, d, d * d);
      normal += row * row.transpose();
      right += row * *c;
    }
  const Eigen::Vector3d parabola = normal.ldlt().solve(right);
  const double offset = parabola[2] < 0 ? -0.5 * parabola[1] / parabola[2] : 0;
  const double fraction = std::isfinite(offset) ? std::clamp(offset, -2.0, 2.0) : 0;
  return TimeShift{(best + fraction) * bin_us, top, *now};
}

}  // namespace pecs::metrics
