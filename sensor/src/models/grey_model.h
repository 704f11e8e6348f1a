#pragma once
// What the other simulators' models share (pixel_model.h).
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <cmath>

#include "pecs/sensor/pixel_model.h"
#include "pecs/sensor/sensor.h"

namespace pecs::sensor {

struct ModelSetup {
  const Chip& chip;
  int width, height;
  std::uint64_t seed;
  double grey_per_unit;  // grey value of a plane's value 1
  std::map<std::string, double> parameters;
  std::size_t pixels() const { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }
  double at(const char* key) const { return parameters.at(key); }
};

struct ModelEntry {
  const char* name;
  const char* source;
  std::span<const ModelParameter> parameters;
  std::unique_ptr<PixelModel> (*make)(const ModelSetup&);
};
extern const ModelEntry kEsim, kV2e, kVoltmeter, kIcns;

// One frame of a batch, after the first of all.
struct Interval {
  double t0_us, t1_us;
  std::int64_t step;  // of the interval since the start
};

// The picture of frame `index` of the batch as grey values.
class Picture {
 public:
  Picture(const FrameBatch& batch, std::size_t index, double grey_per_unit)
      : plane_(batch.planes[index]), scale_(static_cast<float>(grey_per_unit)) {}
  // What is no light keeps the value before; darkness is 0.
  float grey(std::size_t pixel, float before) const {
    const float v = plane_[pixel] * scale_;
    return std::isfinite(v) ? std::max(v, 0.0f) : before;
  }

 private:
  const float* plane_;
  float scale_;
};

inline Interval interval_before(const FrameBatch& batch, std::size_t index) {
  const std::size_t at = batch.t_us.size() - batch.planes.size() + index;
  return {batch.t_us[at - 1], batch.t_us[at], batch.first_frame + static_cast<std::int64_t>(index) - 1};
}

inline constexpr std::size_t kTile = 8192;  // pixels

// work(first pixel, end, events) for tiles of pixels in parallel; tiles that follow each other share a part of the
// order.
template <class Work>
void for_tiles(std::size_t pixels, EventSorter& order, const Work& work) {
  const std::size_t tiles = (pixels + kTile - 1) / kTile;
  const std::size_t parts = std::min(tiles, 4 * static_cast<std::size_t>(tbb::this_task_arena::max_concurrency()));
  order.part(parts - 1);
  tbb::parallel_for(std::size_t{0}, parts, [&](std::size_t part) {
    for (std::size_t i = part * tiles / parts; i < (part + 1) * tiles / parts; ++i)
      work(i * kTile, std::min(pixels, (i + 1) * kTile), order.part(part));
  });
}

}  // namespace pecs::sensor
