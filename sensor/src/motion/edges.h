#pragma once
// Sharp edges in a plane of light: pixels that a straight line divides into two tones. Interpolation between pixels
// blurs such an edge by a quarter of a pixel; the line gives the light of a pixel anywhere near it.
//
// Lines are found as in volume-of-fluid methods (PLIC; Youngs 1982, Rider & Kothe, J. Comput. Phys. 141, 1998), then
// fitted to the 3x3 pixels around, with the width over which the light changes.
#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "motion/surfaces.h"

namespace pecs::sensor::motion {

class Edges {
 public:
  // nx, ny: direction of the darker tone, of length 1. d: position of the edge in this direction, from the pixel's
  // centre. The light changes linearly over `width`.
  struct Line {
    float nx, ny, d, width;
  };
  // Two tones, dark and dark + range. weight: how well they explain the 3x3 pixels, 0 to 1.
  struct Edge {
    Line line;
    float dark, range, weight;
  };

  // The caller keeps both.
  Edges(const float* plane, const Surfaces& from);
  ~Edges();

  // A pixel of a warped picture: its position in the plane, the derivatives of that by the picture's x and y, and its
  // light.
  struct Pixel {
    float u, v;
    Vec2 by_x, by_y;
    float* light;
  };
  static constexpr std::size_t kMost = kTileWidth;
  // Replaces interpolated light of at most kMost pixels by that of the edges near them. Thread-safe.
  void sharpen(std::span<const Pixel> pixels) const;
  // At the edge of a mixed pixel of the plane, or of its occluder: the tones of the occluder and of what is behind it,
  // and the occluder's share in a pixel at (u, v). weight: of the edge against other estimates, 0 to 1.
  struct Outline {
    float front = 0, back = 0, share = 0, weight = 0;
  };
  Outline outline(std::int32_t mixed, float u, float v) const;
  // Whether the pixel of the plane with this index, the next one, or one of the two below may be at an edge; pixels of
  // the warped picture between others need not be sharpened.
  bool may_be_at(std::int32_t index) const {
    return near_[static_cast<std::size_t>(index)].load(std::memory_order_relaxed) != kNo;
  }

 private:
  struct TileEdges;
  enum Near : std::uint8_t { kUnknown, kNo, kYes };
  const TileEdges& tile_at(int x, int y) const;
  void find(int tile, TileEdges& out) const;
  bool fits(int x, int y, Edge& out) const;
  const Edge& edge_of(std::int32_t index) const;  // of weight 0 if there is none

  const float* plane_;
  const Surfaces& from_;
  std::unique_ptr<TileEdges[]> tiles_;
  mutable std::vector<std::atomic<Near>> near_;
};

}  // namespace pecs::sensor::motion
