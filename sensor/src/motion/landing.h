#pragma once
// Finds the points of a keyframe that land on the pixels of a tile at an instant.
#include <cstdint>
#include <span>
#include <vector>

#include "motion/kernel.h"
#include "motion/surfaces.h"

namespace pecs::sensor::motion {

constexpr std::int32_t kNone = -1;

// The point of a keyframe that is visible at a pixel at the instant.
struct VisiblePoint {
  std::int32_t index = kNone;  // of the nearest pixel in the keyframe
  float u = 0, v = 0;          // in the keyframe
  float z = kFar;              // at the instant
  bool is() const { return index != kNone; }
};

// A surface around a pixel of a keyframe at an instant, linear in the keyframe's x and y.
struct Patch {
  std::int32_t index;  // of the pixel
  Vec2 in, now;        // its place in the keyframe and at the instant
  Vec2 by_x, by_y;     // slopes of the displacement per pixel
  float z, z_by_x, z_by_y;
  VisiblePoint at(float x, float y) const;  // the point of the surface that is at (x, y) at the instant
};
// Around the pixel, on its own surface, or on that of its occluder.
Patch patch_of(const Surfaces& from, const Weights& w, std::int32_t index);
Patch boundary_of(const Surfaces& from, const Weights& w, std::int32_t index);

// The nearest point on each pixel of a tile and of a one-pixel margin around it. Occlusion boundaries (mixed pixels,
// with the motion of their occluder) land in a layer of their own.
class Landing {
 public:
  static constexpr int kWidth = kTileWidth + 2, kHeight = kTileHeight + 2;
  static constexpr std::size_t kSlots = std::size_t{kWidth} * kHeight;
  struct Layer {
    float z[kSlots + kSpare], u[kSlots + kSpare], v[kSlots + kSpare];
    std::int32_t index[kSlots + kSpare];
    VisiblePoint seen(std::size_t slot) const { return {index[slot], u[slot], v[slot], z[slot]}; }
  };
  Layer points;
  struct Boundaries {
    float z[kSlots];
    std::int32_t index[kSlots];
    Patch patch[kSlots];
  } boundaries;
  bool has_boundaries = false;

  // tiles: those of the keyframe that may reach this one.
  void land(const Surfaces& from, const Weights& w, const Tile& tile, std::span<const std::int32_t> tiles);
  // Index of pixel (x, y) of the tile.
  static std::size_t slot(int x, int y) { return static_cast<std::size_t>(y + 1) * kWidth + x + 1; }
  static constexpr float kNothing = 2 * kFar;  // depth where nothing landed

 private:
  struct Run;
  void land_part(const Surfaces& from, const Weights& w, int tile, const Tile& part);
  void land_boundaries(const Surfaces& from, const Weights& w, const Tile& part);

  int x0_ = 0, y0_ = 0;
  float paths_[3][kBlockPixels + kSpare];  // of a keyframe's tile with its margin: x, y, depth
};

}  // namespace pecs::sensor::motion
