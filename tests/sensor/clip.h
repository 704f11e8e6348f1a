#pragma once
// Frames in memory for tests, and a sensor that runs over them batch by batch.
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <span>
#include <vector>

#include "pecs/sensor/sensor.h"

namespace pecs::sensor {

struct Clip {
  int width = 0, height = 0;
  std::vector<std::vector<float>> frames;
  std::vector<double> t_us;
};

// value(x, y, t_us) at `n` frames, `h_us` apart.
template <class Value>
Clip make_clip(int width, int height, int n, double h_us, Value&& value) {
  Clip clip{width, height, {}, {}};
  for (int i = 0; i < n; ++i) {
    clip.t_us.push_back(i * h_us);
    auto& frame = clip.frames.emplace_back();
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) frame.push_back(static_cast<float>(value(x, y, i * h_us)));
  }
  return clip;
}

inline std::vector<events::Event> run_clip(Sensor& sensor, const Clip& clip, std::size_t batch, int threads) {
  LabelledEvents found;
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
  tbb::task_arena arena(threads);
  arena.execute([&] {
    for (std::size_t i = 0; i < clip.frames.size(); i += batch) {
      const std::size_t end = std::min(clip.frames.size(), i + batch);
      std::vector<const float*> planes;
      for (std::size_t k = i; k < end; ++k) planes.push_back(clip.frames[k].data());
      sensor.push(planes, std::span(clip.t_us).subspan(i, end - i), end == clip.frames.size(), found);
    }
  });
  return {found.events.begin(), found.events.end()};
}

}  // namespace pecs::sensor
