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

void Residuals::apply(double s, std::span<float> carried) const {
  const auto now = static_cast<float>(s);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, pixels_.size(), 1 << 13), [&](const auto& range) {
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

}  // namespace pecs::sensor
