#pragma once
// Which points of a keyframe land on the pixels of a tile at an instant.
#include <cstdint>
#include <span>
#include <vector>

#include "motion/kernel.h"
#include "motion/surfaces.h"

namespace pecs::sensor::motion {

constexpr std::int32_t kNone = -1;

// Where a keyframe shows what is at a pixel at the instant.
struct Seen {
  std::int32_t index = kNone;  // of the keyframe's pixel beside it
  float u = 0, v = 0;          // in the keyframe
  float z = kFar;              // at the instant
  bool is() const { return index != kNone; }
};

// What the surface of a point shows at (x, y): linear around the point. Or the surface of its owner, carried on to it.
Seen seen_at(const Surfaces& from, const Weights& w, std::int32_t index, float x, float y);
Seen rim_at(const Surfaces& from, const Weights& w, std::int32_t index, float x, float y);

// The nearest on each pixel of a tile and of a frame of one pixel around it: of the points, and of the rims, which are
// soiled pixels with the motion of their owner.
class Landing {
 public:
  static constexpr int kWidth = kTileWidth + 2, kHeight = kTileHeight + 2;
  static constexpr std::size_t kSlots = std::size_t{kWidth} * kHeight;
  struct Layer {
    float z[kSlots + kSpare], u[kSlots + kSpare], v[kSlots + kSpare];
    std::int32_t index[kSlots + kSpare];
    Seen seen(std::size_t slot) const { return {index[slot], u[slot], v[slot], z[slot]}; }
  };
  Layer points, rims;
  bool has_rims = false;

  // tiles: of the keyframe, those that may reach this one.
  void land(const Surfaces& from, const Weights& w, const Tile& tile, std::span<const std::int32_t> tiles);
  // Of a pixel of the tile, by its place in it.
  static std::size_t slot(int x, int y) { return static_cast<std::size_t>(y + 1) * kWidth + x + 1; }
  static constexpr float kNothing = 2 * kFar;  // depth where nothing landed

 private:
  struct Run;
  void land_part(const Surfaces& from, const Weights& w, int tile, const Tile& part);
  void land_rims(const Surfaces& from, const Weights& w, const Tile& part);
  void clear(Layer& layer);

  int x0_ = 0, y0_ = 0;
  float paths_[3][kBlockPixels + kSpare];  // of a keyframe's tile and the pixels around: x, y, depth
};

}  // namespace pecs::sensor::motion
