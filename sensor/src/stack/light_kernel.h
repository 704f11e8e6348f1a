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

// Means over a row of squares of side x side values, from `values` on, in a picture of this width.
inline void average_squares(const float* values, std::size_t width, std::size_t side, std::span<float> means) {
  const float part = 1.0f / static_cast<float>(side * side);
  for (std::size_t x = 0; x < means.size(); ++x, values += side) {
    float sum = 0;
    for (std::size_t row = 0; row < side; ++row)
      for (std::size_t column = 0; column < side; ++column) sum += values[row * width + column];
    means[x] = sum * part;
  }
}

}  // namespace pecs::sensor
