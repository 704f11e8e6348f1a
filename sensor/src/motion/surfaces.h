#pragma once
// What one keyframe shows: its points with their paths, which neighbours belong to one surface, and where blocks of
// them go.
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace pecs::sensor::motion {

// What is known of a pixel of a keyframe.
constexpr std::uint32_t kKnown = 1,              // its motion
    kRight = 2, kLeft = 4, kDown = 8, kUp = 16,  // one surface with the neighbour there
    kSoiled = 32,                                // beside a nearer surface, whose light it may hold in part,
                                                 // and whose motion claims it too: kOwnerShift
    kMixed = 64;                                 // it or a neighbour of its surface is soiled: no wide kernel
constexpr int kOwnerShift =
    8;  // of a soiled one, 4 bits: neighbour that the nearer surface is at, (dy + 1) * 3 + dx + 1

// From keyframe 0 over the middle to the other keyframe.
struct alignas(32) Point {
  float x_mid = 0, y_mid = 0, x_end = 0, y_end = 0;  // displacements [px]
  float z = 0, z_end = 0;
  std::uint32_t flags = 0;
  float unused = 0;
};

struct Vec2 {
  float x = 0, y = 0;
};

// Weights of a point's numbers at the fraction f of its path: the parabola through 0, middle and end; depths linear.
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

// Least and largest displacement of a block, pixels that are about to be claimed by a neighbour's motion included.
struct Reach {
  Vec2 mid_least, mid_most, end_least, end_most;
  bool any = false, moves = false, unknown = false;
  void add(const Point& p);
  void add(const Reach& other);
  // At the fraction of `w`, outwards.
  Vec2 least(const Weights& w) const { return bound(w, mid_least, mid_most, end_least, end_most); }
  Vec2 most(const Weights& w) const { return bound(w, mid_most, mid_least, end_most, end_least); }

 private:
  static Vec2 bound(const Weights& w, Vec2 mid, Vec2, Vec2 end, Vec2 end_other) {
    const Vec2 e = w.end >= 0 ? end : end_other;
    return {w.mid * mid.x + w.end * e.x, w.mid * mid.y + w.end * e.y};
  }
};

constexpr int kTileWidth = 64, kTileHeight = 32;

struct Tile {
  int x0, y0, x1, y1;
};

class Surfaces {
 public:
  // channels: x_mid y_mid x_end y_end z z_end, each [height * width].
  Surfaces(const float* const (&channels)[6], int width, int height);

  int width() const { return width_; }
  int height() const { return height_; }
  const Point& at(std::int32_t index) const { return points_[static_cast<std::size_t>(index)]; }
  const Point& at(int x, int y) const { return at(y * width_ + x); }
  double longest_path_px() const { return longest_; }

  int tiles_x() const { return (width_ + kTileWidth - 1) / kTileWidth; }
  int tiles_y() const { return (height_ + kTileHeight - 1) / kTileHeight; }
  Tile tile(int index) const;
  const Reach& reach(int tile) const { return reach_[static_cast<std::size_t>(tile)]; }

 private:
  std::uint32_t links_of(int x, int y) const;
  Reach reach_of(const Tile& tile) const;

  int width_, height_;
  double longest_ = 0;
  std::vector<Point> points_;
  std::vector<Reach> reach_;
};

}  // namespace pecs::sensor::motion
