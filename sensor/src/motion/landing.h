#pragma once
// Which points of a keyframe land on the pixels of a tile at an instant.
#include <cstdint>
#include <limits>
#include <vector>

#include "motion/surfaces.h"

namespace pecs::sensor::motion {

// Where a point of the keyframe is, and how that changes from pixel to pixel of its surface.
struct Place {
  Vec2 at;          // on the film, at the instant
  Vec2 by_x, by_y;  // slopes of the displacement [px/px]
  float z, z_by_x, z_by_y;
};

// The nearest point on each pixel of a tile and of a frame of one pixel around it.
class Landing {
 public:
  static constexpr int kWidth = kTileWidth + 2, kHeight = kTileHeight + 2;
  static constexpr std::int32_t kNone = -1;

  // tiles: of the keyframe, those that may reach this one.
  void land(const Surfaces& from, const Weights& w, const Tile& tile, std::span<const std::int32_t> tiles);
  // index * 2 + rim of the point at a pixel of the picture, or kNone.
  std::int32_t code(int x, int y) const { return codes_[slot(x, y)]; }
  float depth(int x, int y) const { return depths_[slot(x, y)]; }

 private:
  std::size_t slot(int x, int y) const { return static_cast<std::size_t>((y - y0_) * kWidth + (x - x0_)); }
  void put(Vec2 at, float z, std::int32_t code);

  int x0_ = 0, y0_ = 0;
  float depths_[kWidth * kHeight];
  std::int32_t codes_[kWidth * kHeight];
};

// Of a point as it lands (code: as of Landing).
Place place_of(const Surfaces& from, const Weights& w, std::int32_t code);

}  // namespace pecs::sensor::motion
