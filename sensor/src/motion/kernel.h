#pragma once
// The inner loops of carrying light, compiled for each instruction set (kernel.cpp). Arrays are read and written up to
// kSpare values beyond their end.
#include <cstddef>
#include <cstdint>

namespace pecs::sensor::motion {

constexpr std::size_t kSpare = 16;

// Displacements and depths of a run of points at an instant: weights as of Weights.
struct PathArguments {
  const float* channels;  // of the run's first point
  std::size_t stride;     // from channel to channel
  float mid, end, here, there;
  std::size_t count;
  float *x, *y, *z;
};
void paths(const PathArguments& arguments);

// Which pixel each of a run of points lands on, and what the surface around it shows there: the position in the
// keyframe and the depth, linear around the point. Neighbours that are not of its surface do not count.
struct LandingArguments {
  const float *x, *y, *z;  // displacements and depths of the run; rows above and below, points left and right are there
  std::ptrdiff_t stride;   // of a row
  const std::uint16_t* flags;
  float first_x, row_y;  // of the run's first point
  std::size_t count;
  std::int32_t *column, *row;  // far outside for points whose motion is not known
  float *u, *v, *depth;
};
void land_run(const LandingArguments& arguments);

// For a run of pixels whether it needs a closer look: nothing landed, or something nearer landed beside it. depths: of
// the first pixel; rows are `stride` apart. One byte a pixel.
void contested(const float* depths, std::ptrdiff_t stride, float none, std::size_t count, std::uint8_t* out);

// One pass, along rows or columns, from values to the coefficients of the cubic spline through them: kSplineTaps values
// around each, the middle one its own.
constexpr int kSplineTaps = 15;
void spline_run(const float* const (&taps)[kSplineTaps], std::size_t count, float* out);

// The spline (by its coefficients) at positions, within the range of the four pixels around (of `plane`) and a part of
// it beyond; a pixel's own value at its centre; NaN where one of the four is not finite. Planes have more than three
// rows and columns. Nearer to the border than two pixels the result is of other positions.
void cubic_run(const float* plane, const float* coefficients, int width, int height, const float* u, const float* v,
               std::size_t count, float* out);
// How far beyond the range of the four: of that range, and below at most this part of the least.
constexpr float kBeyond = 0.25f;

// out = a^(1-s) b^s; linear where one is not positive; a where they are equal; the other where one is not finite.
void blend_run(const float* a, const float* b, float s, std::size_t count, float* out);

}  // namespace pecs::sensor::motion
