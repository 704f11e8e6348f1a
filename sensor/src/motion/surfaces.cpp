#include "motion/surfaces.h"

#include <tbb/parallel_for.h>

#include <limits>

namespace pecs::sensor::motion {
namespace {

constexpr float kOneSurface_px = 0.5f;  // that neighbours of one surface may part within an interval
constexpr float kSameSlope = 0.25f;     // or: how much their distance may differ from that of the next neighbours

// How far two points part, at the middle or at the end.
struct Parting {
  Parting(const Point& a, const Point& b)
      : d{b.x_mid - a.x_mid, b.y_mid - a.y_mid, b.x_end - a.x_end, b.y_end - a.y_end} {}
  float most() const {
    return std::max(std::max(std::abs(d[0]), std::abs(d[1])), std::max(std::abs(d[2]), std::abs(d[3])));
  }
  float from(const Parting& o) const {
    float far = 0;
    for (int k = 0; k < 4; ++k) far = std::max(far, std::abs(d[k] - o.d[k]));
    return far;
  }
  float d[4];
};

bool is_known(const Point& p) {
  return std::isfinite(p.x_mid + p.y_mid + p.x_end + p.y_end) && !std::isnan(p.z + p.z_end);
}

float moved2(const Point& p) { return p.x_end * p.x_end + p.y_end * p.y_end; }

// What is as far and moves more counts as nearer (of coplanar things it is the one that lies on the other).
bool is_nearer(const Point& a, const Point& b) { return a.z < b.z || (a.z == b.z && moved2(a) > moved2(b)); }

}  // namespace

void Reach::add(const Point& p) {
  const Vec2 mid{p.x_mid, p.y_mid}, end{p.x_end, p.y_end};
  moves |= mid.x != 0 || mid.y != 0 || end.x != 0 || end.y != 0;
  if (!any) {
    mid_least = mid_most = mid, end_least = end_most = end;
    any = true;
    return;
  }
  const auto stretch = [](Vec2& least, Vec2& most, Vec2 to) {
    least = {std::min(least.x, to.x), std::min(least.y, to.y)};
    most = {std::max(most.x, to.x), std::max(most.y, to.y)};
  };
  stretch(mid_least, mid_most, mid);
  stretch(end_least, end_most, end);
}

Surfaces::Surfaces(const float* const (&channels)[6], int width, int height) : width_(width), height_(height) {
  std::ranges::copy(channels, channels_);
  flags_.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  std::vector<float> longest(static_cast<std::size_t>(height));
  tbb::parallel_for(0, height, [&](int y) {
    float most = 0;
    for (int x = 0; x < width; ++x) {
      const Point p = at(y * width + x);
      if (!is_known(p)) continue;
      flags_[static_cast<std::size_t>(y * width + x)] = kKnown;
      most = std::max(most, std::hypot(p.x_mid, p.y_mid) + std::hypot(p.x_end - p.x_mid, p.y_end - p.y_mid));
    }
    longest[static_cast<std::size_t>(y)] = most;
  });
  longest_ = *std::ranges::max_element(longest);

  // In three passes, each of which looks at what the one before found of the neighbours.
  std::vector<std::uint16_t> found(flags_.size());
  const auto add = [&](const auto& value) {
    tbb::parallel_for(0, height, [&](int y) {
      for (int x = 0; x < width; ++x) found[static_cast<std::size_t>(y * width + x)] = value(x, y);
    });
    for (std::size_t i = 0; i < flags_.size(); ++i) flags_[i] |= found[i];
  };
  add([&](int x, int y) { return links_of(x, y); });
  add([&](int x, int y) { return rim_of(x, y); });
  add([&](int x, int y) -> std::uint16_t {
    bool soiled = flags(y * width_ + x) & kSoiled;
    for (int dy = -1; dy <= 1; ++dy)
      for (int dx = -1; dx <= 1; ++dx)
        if ((dx || dy) && joined(y * width_ + x, dx, dy)) soiled |= (flags((y + dy) * width_ + x + dx) & kSoiled) != 0;
    return soiled ? kMixed : 0;
  });

  const int tiles = tiles_x() * tiles_y();
  reach_.resize(static_cast<std::size_t>(tiles));
  tbb::parallel_for(0, tiles, [&](int i) { reach_[static_cast<std::size_t>(i)] = reach_of(tile(i)); });
}

bool Surfaces::joined(std::int32_t index, int dx, int dy) const {
  const std::uint16_t to_x = dx > 0 ? kRight : kLeft, to_y = dy > 0 ? kDown : kUp, mine = flags(index);
  if (dy == 0) return mine & to_x;
  if (dx == 0) return mine & to_y;
  return ((mine & to_x) && (flags(index + dx) & to_y)) || ((mine & to_y) && (flags(index + dy * width_) & to_x));
}

Tile Surfaces::tile(int index) const {
  const int x = index % tiles_x() * kTileWidth, y = index / tiles_x() * kTileHeight;
  return {x, y, std::min(x + kTileWidth, width_), std::min(y + kTileHeight, height_)};
}

// Of a pixel b and its neighbour c, in a row a b c d: one surface if they hardly part, or as much as their neighbours
// do.
std::uint16_t Surfaces::links_of(int x, int y) const {
  const auto known = [&](int column, int row) {
    return column >= 0 && column < width_ && row >= 0 && row < height_ && (flags(row * width_ + column) & kKnown);
  };
  if (!known(x, y)) return 0;
  const Point b = at(y * width_ + x);
  const auto with = [&](int dx, int dy, std::uint16_t flag) -> std::uint16_t {
    if (!known(x + dx, y + dy)) return 0;
    const std::int32_t step = dy * width_ + dx, here = y * width_ + x;
    const Point c = at(here + step);
    const Parting parting(b, c);
    if (parting.most() <= kOneSurface_px) return flag;
    if (!known(x - dx, y - dy) || !known(x + 2 * dx, y + 2 * dy)) return 0;
    const float off = kSameSlope * parting.most();
    const bool even =
        parting.from(Parting(at(here - step), b)) <= off && parting.from(Parting(c, at(here + 2 * step))) <= off;
    return even ? flag : std::uint16_t{0};
  };
  return with(1, 0, kRight) | with(-1, 0, kLeft) | with(0, 1, kDown) | with(0, -1, kUp);
}

// kSoiled and the owner of a pixel beside a nearer surface, else 0: of its neighbours the one that shares a side, then
// the nearest.
std::uint16_t Surfaces::rim_of(int x, int y) const {
  const std::int32_t here = y * width_ + x;
  if (!(flags(here) & kKnown)) return 0;
  constexpr std::uint16_t kAll = kRight | kLeft | kDown | kUp;
  const bool inside = x > 0 && y > 0 && x + 1 < width_ && y + 1 < height_;
  if (inside && (flags(here) & kAll) == kAll && (flags(here - 1) & kAll) == kAll && (flags(here + 1) & kAll) == kAll)
    return 0;
  const Point p = at(here);
  Point owner{};
  int best = 0;
  std::uint16_t rim = 0;
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx) {
      if ((dx == 0 && dy == 0) || x + dx < 0 || x + dx >= width_ || y + dy < 0 || y + dy >= height_) continue;
      const std::int32_t there = here + dy * width_ + dx;
      const Point q = at(there);
      if (!(flags(there) & kKnown) || !is_nearer(q, p) || joined(here, dx, dy)) continue;
      const int rank = dx == 0 || dy == 0 ? 2 : 1;
      if (rank < best || (rank == best && !is_nearer(q, owner))) continue;
      best = rank;
      owner = q;
      rim = static_cast<std::uint16_t>(kSoiled | ((dy + 1) * 3 + dx + 1) << kOwnerShift);
    }
  return rim;
}

// With the pixels around, whose motion may claim those at the block's rim.
Reach Surfaces::reach_of(const Tile& tile) const {
  Reach reach;
  for (int y = std::max(tile.y0 - 1, 0); y < std::min(tile.y1 + 1, height_); ++y)
    for (int x = std::max(tile.x0 - 1, 0); x < std::min(tile.x1 + 1, width_); ++x) {
      const std::int32_t index = y * width_ + x;
      reach.soiled |= (flags(index) & kSoiled) != 0;
      if (flags(index) & kKnown)
        reach.add(at(index));
      else
        reach.unknown = true;
    }
  return reach;
}

}  // namespace pecs::sensor::motion
