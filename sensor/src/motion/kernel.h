#pragma once
// The inner loops of Carrier, compiled for each instruction set (kernel.cpp). They read and write arrays up to kSpare
// values beyond their end.
#include <array>
#include <cstddef>
#include <cstdint>

namespace pecs::sensor::motion {

constexpr std::size_t kSpare = 16;

constexpr std::size_t kQuarters = 4;                      // places of a path, at equal times; the last at its end
constexpr std::size_t kPathChannels = 2 * kQuarters + 2;  // x and y of each, depth at start and end

// Computes displacements and depths of a run of points at an instant, with the weights of `Weights`.
struct PathArguments {
  const float* channels;  // of the run's first point
  std::size_t stride;     // from channel to channel
  std::array<float, kQuarters> quarters;
  float here, there;
  std::size_t count;
  float *x, *y, *z;
};
void paths(const PathArguments& arguments);

// Finds the pixel on which each point of a run lands, and for that pixel the position in the keyframe and the depth,
// extrapolated linearly over the point's surface. Neighbours on other surfaces are not used.
struct LandingArguments {
  const float *x, *y, *z;  // displacements and depths of the run; neighbours in all four directions exist
  std::ptrdiff_t stride;   // of a row
  const std::uint16_t* flags;
  float first_x, row_y;  // of the run's first point
  std::size_t count;
  std::int32_t *column, *row;  // far outside for points of unknown motion
  float *u, *v, *depth;
};
void land_run(const LandingArguments& arguments);

// Marks the pixels of a run on which nothing landed, or next to which something nearer landed: one byte per pixel.
// depths: of the first pixel; rows are `stride` apart.
void contested(const float* depths, std::ptrdiff_t stride, float none, std::size_t count, std::uint8_t* out);

// One pass, along rows or columns, from values to the coefficients of the interpolating cubic spline. The middle one of
// the kSplineTaps values is the pixel's own.
constexpr int kSplineTaps = 15;
void spline_run(const float* const (&taps)[kSplineTaps], std::size_t count, float* out);

struct CubicPlane {
  const float *values, *coefficients;
  int width, height;
};
// Evaluates the spline (by its coefficients) at positions. The result is clamped to the range of the four nearest
// values, widened by kBeyond; at a pixel's centre it is the pixel's value; it is NaN where one of the four
// is not finite. Planes have more than three rows and columns. Positions within two pixels of the border give wrong
// values. upper_left: index of that one of the four.
void cubic_run(const CubicPlane& plane, const float* u, const float* v, std::size_t count, float* out,
               std::int32_t* upper_left);
// How far a value may leave the range of the four pixels: by this part of the range, and downwards by no more than this
// part of the least.
constexpr float kBeyond = 0.25f;

// Mean over unit squares of a picture that is 1 where x * nx + y * ny < d from the square's centre, and 0 elsewhere,
// with a ramp of this width in between. The sizes of nx and ny count as at least kLeastSlope.
constexpr float kLeastSlope = 0.005f;
struct LinesArguments {
  const float *nx, *ny, *d, *width;
  std::size_t count;
};
void line_shares(const LinesArguments& lines, float* out);

// out = a^(1-s) b^s. Linear where one is not positive; exactly a where both are equal; the finite one where one is not.
void blend_run(const float* a, const float* b, float s, std::size_t count, float* out);

}  // namespace pecs::sensor::motion
