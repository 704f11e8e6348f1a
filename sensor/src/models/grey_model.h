#pragma once
// Models that take pictures frame by frame: grey values of 0 to 255.
#include <algorithm>
#include <cmath>

#include "models/entry.h"

namespace pecs::sensor {

// Time from the frame before.
struct Interval {
  double t0_us, t1_us;
  std::int64_t step;  // of the interval since the start
};

// The picture of frame `index` of the batch as grey values.
class Picture {
 public:
  Picture(const FrameBatch& batch, std::size_t index, double grey_per_unit)
      : plane_(batch.planes[index]), scale_(static_cast<float>(grey_per_unit)) {}
  // What is no light keeps the value before; darkness is 0. Beyond 4000 times white all is as bright: a model's rate of
  // noise grows with the light, so that more would be events without end.
  float grey(std::size_t pixel, float before) const {
    const float v = plane_[pixel] * scale_;
    return std::isfinite(v) ? std::clamp(v, 0.0f, 1e6f) : before;
  }

 private:
  const float* plane_;
  float scale_;
};

inline Interval interval_before(const FrameBatch& batch, std::size_t index) {
  const std::size_t at = batch.t_us.size() - batch.planes.size() + index;
  return {batch.t_us[at - 1], batch.t_us[at], batch.first_frame + static_cast<std::int64_t>(index) - 1};
}

// start(pixel, picture) for the very first frame, step(pixel, picture, interval) for the others: frame by frame, pixel
// by pixel.
template <class Start, class Step>
void each_frame(const FrameBatch& batch, PixelRange range, double grey_per_unit, const Start& start, const Step& step) {
  for (std::size_t i = 0; i < batch.planes.size(); ++i) {
    const Picture picture(batch, i, grey_per_unit);
    if (batch.first_frame + static_cast<std::int64_t>(i) == 0) {
      for (std::uint32_t k = range.first; k < range.end; ++k) start(k, picture);
    } else {
      const Interval interval = interval_before(batch, i);
      for (std::uint32_t k = range.first; k < range.end; ++k) step(k, picture, interval);
    }
  }
}

}  // namespace pecs::sensor
