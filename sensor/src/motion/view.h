#pragma once
// What both keyframes show of a tile at an instant, whatever their light.
#include <cstdint>
#include <span>
#include <vector>

#include "motion/landing.h"

namespace pecs::sensor::motion {

constexpr std::size_t kTilePixels = std::size_t{kTileWidth} * kTileHeight;

// One keyframe.
struct View {
  explicit View(const Surfaces& keyframe) : from(keyframe) {}
  const Surfaces& from;
  Weights weights{0};
  Landing landing;

  // From the tiles that may reach this one, at the instant of `w`. Pixels beside what is nearer are looked at closely.
  void look(const Weights& w, const Tile& tile, std::span<const std::int32_t> near);
  // The rim that covers a pixel (x, y) of the picture, at (column, row) of the tile.
  Seen rim(int column, int row, int x, int y) const;
  // Whether a rim is before what the other keyframe shows at its pixel.
  bool is_before(const Seen& rim, const Seen& other) const;
};

// Of two points at a pixel that are not the same the nearer one counts.
void drop_hidden(Landing::Layer& a, Landing::Layer& b);

// Pixels of a tile at which a nearer surface's rim is seen, by one keyframe or both.
struct Rim {
  int column, row;
  Seen seen[2];
};
std::vector<Rim> rims_of(const Tile& tile, const View* first, const View* second);

}  // namespace pecs::sensor::motion
