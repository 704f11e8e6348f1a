#include "residuals.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace pecs::sensor {

void Residuals::add(double s, std::span<const float> rendered, std::span<const float> carried) {
  for (std::size_t i = 0; i < rendered.size(); ++i) {
    const float r = std::log(rendered[i] / carried[i]);
    if (std::isfinite(r)) found_.push_back({static_cast<std::uint32_t>(i), {static_cast<float>(s), r}});
  }
}

void Residuals::close() {
  std::ranges::stable_sort(found_, {}, &Found::pixel);  // they came by s
  for (const Found& found : found_) {
    if (pixels_.empty() || pixels_.back() != found.pixel) {
      pixels_.push_back(found.pixel);
      first_.push_back(static_cast<std::uint32_t>(residuals_.size()));
    }
    residuals_.push_back(found.residual);
  }
  first_.push_back(static_cast<std::uint32_t>(residuals_.size()));
  found_ = {};
}

void Residuals::apply(double s, std::span<float> carried, std::size_t begin, std::size_t end) const {
  const auto now = static_cast<float>(s);
  const auto place = [&](std::size_t pixel) {
    return static_cast<std::size_t>(std::ranges::lower_bound(pixels_, pixel) - pixels_.begin());
  };
  tbb::parallel_for(tbb::blocked_range<std::size_t>(place(begin), place(end), 1 << 13), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      Residual before{0, 0}, after{1, 0};
      for (std::uint32_t k = first_[i]; k < first_[i + 1]; ++k) {
        after = residuals_[k];
        if (after.s >= now) break;
        before = after;
        after = {1, 0};
      }
      const float part = after.s > before.s ? (now - before.s) / (after.s - before.s) : 1.0f;
      carried[pixels_[i]] *= std::exp(before.r + part * (after.r - before.r));
    }
  });
}

Residuals residuals_of(PhotocurrentReader& light, std::int64_t frame, double length_us, const Carrier& carrier,
                       const float* first, const float* second, std::vector<double>& instants) {
  const StackInfo& info = light.info();
  const std::vector<std::int64_t> times_ns = light.source().between_ns(frame);
  const auto begin_ns = static_cast<double>(info.times_ns[static_cast<std::size_t>(frame)]);
  const std::size_t values = static_cast<std::size_t>(info.file_width()) * static_cast<std::size_t>(info.file_height());
  std::vector<float> rendered(times_ns.empty() ? 0 : values), carried(rendered.size());
  Residuals residuals;
  for (std::size_t k = 0; k < times_ns.size(); ++k) {
    const double s = (static_cast<double>(times_ns[k]) - begin_ns) / (1e3 * length_us);
    light.read_between(frame, k, rendered.data());
    carrier.plane(first, second, s, carried.data());
    residuals.add(s, rendered, carried);
    instants.push_back(s);
  }
  residuals.close();
  return residuals;
}

}  // namespace pecs::sensor
