#pragma once
// Bytes of an EXR file to light, compiled for each instruction set (light_kernel.cpp).
#include <cstdint>
#include <span>

namespace pecs::sensor {

// OpenEXR's byte predictor, undone in place: each byte holds its difference from the one before, plus 128.
void undo_predictor(std::span<std::uint8_t> bytes);

// out = a0 b0 a1 b1 …, where a is the first half of `in` (the longer one) and b the second. Same sizes.
void interleave_halves(std::span<const std::uint8_t> in, std::span<std::uint8_t> out);

// Little-endian half floats, exactly; `in` needs no alignment.
void halves_to_floats(const std::uint8_t* in, std::span<float> out);

// out[i] = sum over bands of weights[b] * values[b * n + i], n = out.size(). True if some value is negative, infinite
// or NaN (-0 counts as negative).
bool weighted_sum(std::span<const float> weights, const float* values, std::span<float> out);

}  // namespace pecs::sensor
