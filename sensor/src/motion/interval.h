#pragma once
// The motion of an interval: what both keyframes show, and which tiles matter to which.
#include <cstdint>
#include <vector>

#include "motion/surfaces.h"
#include "pecs/sensor/motion.h"

namespace pecs::sensor {

struct Carrier::Interval {
  Interval(int width, int height) : first(width, height), second(width, height) {}
  void put(int y, int rows, const float* values) {
    first.put(y, rows, values);
    second.put(y, rows, values + static_cast<std::ptrdiff_t>(6 * rows) * first.width());
  }
  void close() {
    first.close();
    second.close();
    find_near();
  }
  motion::Surfaces first, second;
  // Of each tile: tiles of either keyframe whose points may come over it.
  struct Near {
    std::vector<std::int32_t> first, second;
    bool still = true;     // nothing moves there
    bool special = false;  // pixels beside the border of the picture or a nearer surface may be seen there
  };
  std::vector<Near> near{};

  void find_near();
};

}  // namespace pecs::sensor
