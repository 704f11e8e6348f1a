#pragma once
// The surfaces in one keyframe: points with their paths, which neighbours share a surface, and how far each block of
// points moves.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "motion/kernel.h"

namespace pecs::sensor::motion {

// Flags of a pixel of a keyframe.
constexpr std::uint16_t kKnown = 1,              // the motion is known
    kRight = 2, kLeft = 4, kDown = 8, kUp = 16,  // shares a surface with that neighbour
    kMixedPixel = 32,  // at an occlusion boundary; may contain light of the occluder (kOccluderShift)
    kNearMixed = 64;   // it or a neighbour on its surface is mixed: no wide kernel
constexpr int kOccluderShift =
    8;  // 4 bits: the neighbour of a mixed pixel that shows the occluder, (dy + 1) * 3 + dx + 1

constexpr float kFar = 1e30f;  // depth of points without one

struct Vec2 {
  float x = 0, y = 0;
};

// Motion of a point from its keyframe to the other one.
struct Point {
  std::array<Vec2, kQuarters> moved;  // displacements after each quarter of the interval [px]
  float z, z_end;                     // at most kFar
};

// Weights of a point's values at the fraction f of its path: a polynomial of degree 4 through the start and the four
// places (Lagrange's form); depths are linear.
struct Weights {
  explicit Weights(double f);
  Vec2 path(const Point& p) const {
    Vec2 out;
    for (std::size_t q = 0; q < kQuarters; ++q)
      out = {out.x + quarters[q] * p.moved[q].x, out.y + quarters[q] * p.moved[q].y};
    return out;
  }
  float depth(const Point& p) const { return here * p.z + there * p.z_end; }
  std::array<float, kQuarters> quarters;
  float here, there;
};

// Least and largest displacements of a block, after each quarter of the interval, and the longest path if all quarters
// were as fast as the fastest, squared.
struct Reach {
  std::array<Vec2, kQuarters> lowest, highest;
  float longest2 = 0;
  bool any = false, moves = false, unknown = false, mixed = false;
  void add(const std::array<Vec2, kQuarters>& moved);
  // Bounds of the displacement at the fraction of `w`.
  Vec2 least(const Weights& w) const { return at(w, lowest, highest); }
  Vec2 most(const Weights& w) const { return at(w, highest, lowest); }

 private:
  // positive, negative: what counts where the weight is so.
  static Vec2 at(const Weights& w, const std::array<Vec2, kQuarters>& positive,
                 const std::array<Vec2, kQuarters>& negative) {
    Vec2 out;
    for (std::size_t q = 0; q < kQuarters; ++q) {
      const Vec2 p = w.quarters[q] >= 0 ? positive[q] : negative[q];
      out = {out.x + w.quarters[q] * p.x, out.y + w.quarters[q] * p.y};
    }
    return out;
  }
};

constexpr int kTileWidth = 64, kTileHeight = 32;

struct Tile {
  int x0, y0, x1, y1;
};

// A tile's points with a margin of one pixel: channel by channel, row by row.
constexpr int kBlockWidth = kTileWidth + 2, kBlockHeight = kTileHeight + 2;
constexpr std::size_t kBlockPixels = std::size_t{kBlockWidth} * kBlockHeight;
// Index of pixel (x, y) of the tile within a channel.
constexpr std::ptrdiff_t block_place(int x, int y) { return static_cast<std::ptrdiff_t>(y + 1) * kBlockWidth + x + 1; }

class Surfaces {
 public:
  Surfaces(int width, int height);
  // Rows from y on: values[(channel * rows + row) * width + x], x and y after each quarter, z z_end.
  void put(int y, int rows, const float* values);
  // After all rows. In the caller's TBB arena.
  void close();

  int width() const { return width_; }
  int height() const { return height_; }
  Vec2 position(std::int32_t index) const {
    const int x = index % width_, y = index / width_;
    return {static_cast<float>(x), static_cast<float>(y)};
  }
  // A pixel's values in its tile's block, whose margin holds the neighbours in other tiles.
  const float* where(std::int32_t index) const {
    const int x = index % width_, y = index / width_;
    return block(y / kTileHeight * tiles_x() + x / kTileWidth) + block_place(x % kTileWidth, y % kTileHeight);
  }
  static Point at(const float* p) {
    return {moved(p), p[(kPathChannels - 2) * kBlockPixels], p[(kPathChannels - 1) * kBlockPixels]};
  }
  static std::array<Vec2, kQuarters> moved(const float* p) {
    std::array<Vec2, kQuarters> out;
    for (std::size_t q = 0; q < kQuarters; ++q) out[q] = {p[2 * q * kBlockPixels], p[(2 * q + 1) * kBlockPixels]};
    return out;
  }
  Point at(std::int32_t index) const { return at(where(index)); }
  std::uint16_t flags(std::int32_t index) const { return flags_[static_cast<std::size_t>(index)]; }
  // [kPathChannels][kBlockHeight][kBlockWidth] of a tile; 0 beyond the picture.
  const float* block(int tile) const {
    return blocks_.data() + static_cast<std::size_t>(tile) * kPathChannels * kBlockPixels;
  }
  // Step from a mixed pixel to the neighbour that shows its occluder.
  struct Step {
    int dx, dy;
  };
  Step occluder(std::int32_t index) const {
    const int place = flags(index) >> kOccluderShift;
    return {place % 3 - 1, place / 3 - 1};
  }
  // Whether a pixel shares a surface with its neighbour (dx, dy), which may be a diagonal one.
  bool joined(std::int32_t index, int dx, int dy) const;
  double longest_path_px() const { return longest_; }

  int tiles_x() const { return (width_ + kTileWidth - 1) / kTileWidth; }
  int tiles_y() const { return (height_ + kTileHeight - 1) / kTileHeight; }
  Tile tile(int index) const;
  const Reach& reach(int tile) const { return reach_[static_cast<std::size_t>(tile)]; }

 private:
  void link(int tile);
  std::uint16_t links_of(int x, int y, std::uint16_t flag) const;
  std::uint16_t mixed_of(int x, int y) const;
  std::uint16_t near_mixed_of(int x, int y) const;
  Reach reach_of(int index) const;

  int width_, height_;
  double longest_ = 0;
  std::vector<float> blocks_;
  std::vector<std::uint16_t> flags_;
  std::vector<Reach> reach_;
};

}  // namespace pecs::sensor::motion
