#pragma once
// For models that work frame by frame: light or grey values of a frame, times of the interval before it, and the loop.
#include <algorithm>
#include <cmath>
#include <limits>

#include "models/entry.h"

namespace pecs::sensor {

// From a frame to the next one.
struct FrameInterval {
  double begin_us, end_us;
  std::int64_t index;  // since the start
};

// A frame of the batch, in the model's unit: `per_unit` is that of a plane's value 1 (ModelSetup).
class FramePlane {
 public:
  FramePlane(const FrameBatch& batch, std::size_t index, double per_unit)
      : plane_(batch.planes[index]), per_unit_(static_cast<float>(per_unit)) {}
  // Negative values are 0. A value that is not finite is the pixel's value before.
  float value(std::size_t pixel, float before, float most = std::numeric_limits<float>::max()) const {
    const float v = plane_[pixel] * per_unit_;
    return std::isfinite(v) ? std::clamp(v, 0.0f, most) : before;
  }
  // Grey values are clamped to 4000 times white: a model's noise rate grows with the light, so that without a limit the
  // number of noise events has none either.
  float grey(std::size_t pixel, float before) const { return value(pixel, before, 1e6f); }

 private:
  const float* plane_;
  float per_unit_;
};

// The interval that ends at frame `index` of the batch.
inline FrameInterval interval_before(const FrameBatch& batch, std::size_t index) {
  const std::size_t at = batch.t_us.size() - batch.planes.size() + index;
  return {batch.t_us[at - 1], batch.t_us[at], batch.first_frame + static_cast<std::int64_t>(index) - 1};
}

// start(pixel, frame) for the first frame of all, step(pixel, frame, interval) for every later one: frame by frame,
// pixel by pixel.
template <class Start, class Step>
void each_frame(const FrameBatch& batch, PixelRange range, double per_unit, const Start& start, const Step& step) {
  for (std::size_t i = 0; i < batch.planes.size(); ++i) {
    const FramePlane frame(batch, i, per_unit);
    if (batch.first_frame + static_cast<std::int64_t>(i) == 0) {
      for (std::uint32_t k = range.first; k < range.end; ++k) start(k, frame);
    } else {
      const FrameInterval interval = interval_before(batch, i);
      for (std::uint32_t k = range.first; k < range.end; ++k) step(k, frame, interval);
    }
  }
}

}  // namespace pecs::sensor
