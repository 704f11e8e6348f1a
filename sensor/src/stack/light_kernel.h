#pragma once
// From the bytes of an EXR file to light. Compiled for each instruction set (light_kernel.cpp).
#include <cstddef>
#include <cstdint>
#include <span>

namespace pecs::sensor {

// Inverts OpenEXR's byte predictor in place: each byte is its difference from the one before, plus 128.
void undo_predictor(std::span<std::uint8_t> bytes);

// out = a0 b0 a1 b1 …, where a is the first half of `in` (the longer one) and b the second. Same sizes.
void interleave_halves(std::span<const std::uint8_t> in, std::span<std::uint8_t> out);

// Converts little-endian half floats exactly; `in` needs no alignment.
void halves_to_floats(const std::uint8_t* in, std::span<float> out);

// out[i] = sum over bands of weights[b] * values[b * n + i], n = out.size(). Returns whether a value is negative,
// infinite or NaN (-0 counts as negative).
bool weighted_sum(std::span<const float> weights, const float* values, std::span<float> out);

// Means over squares of side x side values: rows of `width` values become rows of width / side. The numbers of columns
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
