#pragma once
// The motion of an interval: the surfaces in both keyframes, and which tiles their points can reach.
#include <cstdint>
#include <vector>

#include "motion/surfaces.h"
#include "pecs/sensor/motion.h"

namespace pecs::sensor {

static_assert(kMotionChannels == 2 * motion::kPathChannels);

struct Carrier::KeyframeInterval {
  KeyframeInterval(int width, int height) : first(width, height), second(width, height) {}
  void put(int y, int rows, const float* values) {
    first.put(y, rows, values);
    second.put(y, rows, values + static_cast<std::ptrdiff_t>(motion::kPathChannels) * rows * first.width());
  }
  void close() {
    first.close();
    second.close();
    find_near();
  }
  motion::Surfaces first, second;
  // For each tile: the tiles of either keyframe whose points may reach it.
  struct Near {
    std::vector<std::int32_t> first, second;
    bool still = true;     // nothing that reaches the tile moves
    bool special = false;  // pixels at the picture's border or at an occlusion boundary may reach it
    float path2 = 0;       // the longest path of these points [px^2]; infinite where a motion is unknown
  };
  std::vector<Near> near{};

  void find_near();
};

}  // namespace pecs::sensor
