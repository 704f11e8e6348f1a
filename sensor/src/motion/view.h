#pragma once
// Visibility of both keyframes' points in a tile at an instant; independent of their light.
#include <cstdint>
#include <span>
#include <vector>

#include "motion/landing.h"

namespace pecs::sensor::motion {

constexpr std::size_t kTilePixels = std::size_t{kTileWidth} * kTileHeight;

// The points of one keyframe.
struct View {
  explicit View(const Surfaces& keyframe) : from(keyframe) {}
  const Surfaces& from;
  Weights weights{0};
  Landing landing;

  // Lands the points of the tiles that may reach this one, at the instant of `w`, and resolves which surface covers
  // pixels next to a nearer one.
  void look(const Weights& w, const Tile& tile, std::span<const std::int32_t> near);
  // The boundary pixel that covers pixel (x, y) of the picture, (column, row) of the tile.
  VisiblePoint boundary(int column, int row, int x, int y) const;
  // Whether a boundary pixel is in front of the point that the other keyframe shows there.
  bool is_before(const VisiblePoint& boundary, const VisiblePoint& other) const;
};

// Removes the farther one of two different points that land on one pixel.
void drop_hidden(Landing::Layer& a, Landing::Layer& b);

// A pixel of a tile at which one keyframe or both show the boundary of a nearer surface.
struct BoundaryPixel {
  int column, row;
  VisiblePoint seen[2];
};
std::vector<BoundaryPixel> boundaries_of(const Tile& tile, const View* first, const View* second);

}  // namespace pecs::sensor::motion
