#pragma once
// The surfaces in one keyframe: points with their paths, which neighbours share a surface, and how far each block of
// points moves.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

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

// Motion of a point from its keyframe over the middle of the interval to the other keyframe.
struct Point {
  float x_mid, y_mid, x_end, y_end;  // displacements [px]
  float z, z_end;                    // at most kFar
};

// Weights of a point's values at the fraction f of its path: a parabola through 0, middle and end; depths are linear.
struct Weights {
  explicit Weights(double f)
      : mid(static_cast<float>(4 * f * (1 - f))),
        end(static_cast<float>(f * (2 * f - 1))),
        here(static_cast<float>(1 - f)),
        there(static_cast<float>(f)) {}
  Vec2 path(const Point& p) const { return {mid * p.x_mid + end * p.x_end, mid * p.y_mid + end * p.y_end}; }
  float depth(const Point& p) const { return here * p.z + there * p.z_end; }
  float mid, end, here, there;
};

// Least and largest displacement of a block.
struct Reach {
  Vec2 mid_least, mid_most, end_least, end_most;
  bool any = false, moves = false, unknown = false, mixed = false;
  void add(const Point& p);
  // Bounds of the displacement at the fraction of `w`.
  Vec2 least(const Weights& w) const { return at(w, mid_least, w.end >= 0 ? end_least : end_most); }
  Vec2 most(const Weights& w) const { return at(w, mid_most, w.end >= 0 ? end_most : end_least); }

 private:
  static Vec2 at(const Weights& w, Vec2 m, Vec2 e) { return {w.mid * m.x + w.end * e.x, w.mid * m.y + w.end * e.y}; }
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
  // Rows from y on: values[(channel * rows + row) * width + x], x_mid y_mid x_end y_end z z_end.
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
    const auto value = [&](std::size_t c) { return p[c * kBlockPixels]; };
    return {value(0), value(1), value(2), value(3), value(4), value(5)};
  }
  Point at(std::int32_t index) const { return at(where(index)); }
  std::uint16_t flags(std::int32_t index) const { return flags_[static_cast<std::size_t>(index)]; }
  // [6][kBlockHeight][kBlockWidth] of a tile; 0 beyond the picture.
  const float* block(int tile) const { return blocks_.data() + static_cast<std::size_t>(tile) * 6 * kBlockPixels; }
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
  float link(int tile);
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
