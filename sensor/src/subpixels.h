#pragma once
#include <cstddef>
#include <span>

namespace pecs::sensor {

// Means of side x side squares: planes of rows of `width` values into planes of width / side. The numbers of columns
// and rows are multiples of side.
inline void average_squares(std::span<const float> values, int width, int side, std::span<float> means) {
  const auto columns = static_cast<std::size_t>(width), step = static_cast<std::size_t>(side);
  const float part = 1.0f / static_cast<float>(side * side);
  for (std::size_t i = 0; i < means.size(); ++i) {
    const std::size_t y = i / (columns / step), x = i % (columns / step);
    const float* corner = values.data() + y * step * columns + x * step;
    float sum = 0;
    for (std::size_t row = 0; row < step; ++row)
      for (std::size_t column = 0; column < step; ++column) sum += corner[row * columns + column];
    means[i] = sum * part;
  }
}

}  // namespace pecs::sensor
