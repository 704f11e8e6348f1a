#pragma once
// Light of a keyframe between its pixels.
#include <algorithm>
#include <cmath>

#include "motion/surfaces.h"

namespace pecs::sensor::motion {

// Catmull-Rom weights of the pixels -1, 0, 1, 2 at the fraction f between 0 and 1.
inline void catmull_rom(float f, float (&w)[4]) {
  const float g = 1 - f;
  w[0] = -0.5f * f * g * g;
  w[1] = g * (1 + f - 1.5f * f * f);
  w[2] = f * (1 + g - 1.5f * g * g);
  w[3] = -0.5f * f * f * g;
}

// Bicubic, clamped to the range of the four pixels around; beyond the border the border's pixels go on.
inline float cubic(const float* plane, int width, int height, float u, float v) {
  const int x = static_cast<int>(std::floor(u)), y = static_cast<int>(std::floor(v));
  float wx[4], wy[4];
  catmull_rom(u - static_cast<float>(x), wx);
  catmull_rom(v - static_cast<float>(y), wy);
  float sum = 0, least = std::numeric_limits<float>::infinity(), most = -least;
  for (int j = 0; j < 4; ++j) {
    const float* row = plane + static_cast<std::ptrdiff_t>(std::clamp(y - 1 + j, 0, height - 1)) * width;
    float part = 0;
    for (int i = 0; i < 4; ++i) {
      const float value = row[std::clamp(x - 1 + i, 0, width - 1)];
      part += wx[i] * value;
      if ((i == 1 || i == 2) && (j == 1 || j == 2)) least = std::min(least, value), most = std::max(most, value);
    }
    sum += wy[j] * part;
  }
  return std::isfinite(sum) ? std::clamp(sum, least, most) : std::numeric_limits<float>::quiet_NaN();
}

}  // namespace pecs::sensor::motion
