#include "motion/surfaces.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace pecs::sensor::motion {
namespace {

constexpr float kOneSurface = 0.5f;  // px that neighbours of one surface may part within an interval
constexpr float kSameSlope = 0.25f;  // or: how much their distance may differ from that of the next neighbours

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

// Whether b and c, in a row a b c d of points, are of one surface: they hardly part, or as much as their neighbours do.
bool one_surface(const Point* a, const Point& b, const Point& c, const Point* d) {
  if (!(b.flags & c.flags & kKnown)) return false;
  const Parting here(b, c);
  if (here.most() <= kOneSurface) return true;
  if (!a || !d || !(a->flags & d->flags & kKnown)) return false;
  const float off = kSameSlope * here.most();
  return here.from(Parting(*a, b)) <= off && here.from(Parting(c, *d)) <= off;
}

float moved2(const Point& p) { return p.x_end * p.x_end + p.y_end * p.y_end; }

// What is as far and moves more counts as nearer (of coplanar things it is the one that lies on the other).
bool is_nearer(const Point& a, const Point& b) { return a.z < b.z || (a.z == b.z && moved2(a) > moved2(b)); }

// Of a pixel's neighbours, by the links of all pixels.
struct Links {
  bool joined(int x, int y, int dx, int dy) const {
    const auto has = [&](int column, int row, std::uint32_t flag) {
      return (flags[static_cast<std::size_t>(row) * width + static_cast<std::size_t>(column)] & flag) != 0;
    };
    const std::uint32_t to_x = dx > 0 ? kRight : kLeft, to_y = dy > 0 ? kDown : kUp;
    if (dy == 0) return has(x, y, to_x);
    if (dx == 0) return has(x, y, to_y);
    return (has(x, y, to_x) && has(x + dx, y, to_y)) || (has(x, y, to_y) && has(x, y + dy, to_x));  // over a corner
  }
  // visit(dx, dy) for the eight neighbours that there are.
  template <class Visit>
  void around(int x, int y, const Visit& visit) const {
    for (int dy = -1; dy <= 1; ++dy)
      for (int dx = -1; dx <= 1; ++dx)
        if ((dx != 0 || dy != 0) && x + dx >= 0 && x + dx < static_cast<int>(width) && y + dy >= 0 &&
            y + dy < static_cast<int>(height))
          visit(dx, dy);
  }
  const std::vector<std::uint8_t>& flags;
  std::size_t width, height;
};

// kSoiled and the owner of a pixel beside a nearer surface, else 0: of its neighbours the one that shares a side,
// then the nearest.
std::uint32_t rim_of(const Surfaces& surfaces, const Links& links, int x, int y) {
  const Point& p = surfaces.at(x, y);
  if (!(p.flags & kKnown)) return 0;
  const Point* owner = nullptr;
  int best = 0;
  std::uint32_t rim = 0;
  links.around(x, y, [&](int dx, int dy) {
    const Point& q = surfaces.at(x + dx, y + dy);
    if (!(q.flags & kKnown) || !is_nearer(q, p) || links.joined(x, y, dx, dy)) return;
    const int rank = dx == 0 || dy == 0 ? 2 : 1;
    if (rank < best || (rank == best && !is_nearer(q, *owner))) return;
    best = rank;
    owner = &q;
    rim = kSoiled | static_cast<std::uint32_t>((dy + 1) * 3 + dx + 1) << kOwnerShift;
  });
  return rim;
}

}  // namespace

void Reach::add(const Point& p) {
  const Vec2 mid{p.x_mid, p.y_mid}, end{p.x_end, p.y_end};
  Reach one;
  one.mid_least = one.mid_most = mid;
  one.end_least = one.end_most = end;
  one.any = true;
  one.moves = mid.x != 0 || mid.y != 0 || end.x != 0 || end.y != 0;
  add(one);
}

void Reach::add(const Reach& o) {
  if (!o.any) return;
  if (!any) {
    const bool holes = unknown;
    *this = o;
    unknown |= holes;
    return;
  }
  const auto least = [](Vec2 a, Vec2 b) { return Vec2{std::min(a.x, b.x), std::min(a.y, b.y)}; };
  const auto most = [](Vec2 a, Vec2 b) { return Vec2{std::max(a.x, b.x), std::max(a.y, b.y)}; };
  mid_least = least(mid_least, o.mid_least), end_least = least(end_least, o.end_least);
  mid_most = most(mid_most, o.mid_most), end_most = most(end_most, o.end_most);
  moves |= o.moves;
  unknown |= o.unknown;
}

Surfaces::Surfaces(const float* const (&channels)[6], int width, int height)
    : width_(width), height_(height), points_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height)) {
  const auto row_of = [&](int y) { return points_.data() + static_cast<std::ptrdiff_t>(y) * width; };
  std::vector<float> longest(static_cast<std::size_t>(height));
  tbb::parallel_for(0, height, [&](int y) {
    float most = 0;
    for (int x = 0; x < width; ++x) {
      const std::ptrdiff_t i = static_cast<std::ptrdiff_t>(y) * width + x;
      Point& p = row_of(y)[x];
      p = {channels[0][i], channels[1][i], channels[2][i], channels[3][i], channels[4][i], channels[5][i]};
      const bool known = std::isfinite(p.x_mid + p.y_mid + p.x_end + p.y_end) && !std::isnan(p.z + p.z_end);
      p.flags = known ? kKnown : 0;
      if (known) most = std::max(most, std::hypot(p.x_mid, p.y_mid) + std::hypot(p.x_end - p.x_mid, p.y_end - p.y_mid));
    }
    longest[static_cast<std::size_t>(y)] = most;
  });
  longest_ = *std::ranges::max_element(longest);

  const auto index = [&](int x, int y) {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
  };
  const auto each = [&](auto& out, const auto& value) {
    out.resize(points_.size());
    tbb::parallel_for(0, height, [&](int y) {
      for (int x = 0; x < width; ++x) out[index(x, y)] = static_cast<std::decay_t<decltype(out[0])>>(value(x, y));
    });
  };
  std::vector<std::uint8_t> joined, mixed;
  std::vector<std::uint16_t> rims;
  const Links links{joined, static_cast<std::size_t>(width), static_cast<std::size_t>(height)};
  each(joined, [&](int x, int y) { return links_of(x, y); });
  each(rims, [&](int x, int y) { return rim_of(*this, links, x, y); });
  each(mixed, [&](int x, int y) {
    std::uint32_t soiled = rims[index(x, y)] & kSoiled;
    links.around(x, y, [&](int dx, int dy) {
      if (rims[index(x + dx, y + dy)] && links.joined(x, y, dx, dy)) soiled = kSoiled;
    });
    return soiled ? kMixed : 0;
  });
  tbb::parallel_for(std::size_t{0}, points_.size(),
                    [&](std::size_t i) { points_[i].flags |= joined[i] | rims[i] | mixed[i]; });

  const int tiles = tiles_x() * tiles_y();
  reach_.resize(static_cast<std::size_t>(tiles));
  tbb::parallel_for(0, tiles, [&](int i) { reach_[static_cast<std::size_t>(i)] = reach_of(tile(i)); });
}

Tile Surfaces::tile(int index) const {
  const int x = index % tiles_x() * kTileWidth, y = index / tiles_x() * kTileHeight;
  return {x, y, std::min(x + kTileWidth, width_), std::min(y + kTileHeight, height_)};
}

std::uint32_t Surfaces::links_of(int x, int y) const {
  const auto inside = [&](int column, int row) {
    return column >= 0 && column < width_ && row >= 0 && row < height_ ? &at(column, row) : nullptr;
  };
  const auto with = [&](int dx, int dy) {
    const Point* next = inside(x + dx, y + dy);
    return next && one_surface(inside(x - dx, y - dy), at(x, y), *next, inside(x + 2 * dx, y + 2 * dy));
  };
  return (with(1, 0) ? kRight : 0u) | (with(-1, 0) ? kLeft : 0u) | (with(0, 1) ? kDown : 0u) | (with(0, -1) ? kUp : 0u);
}

Reach Surfaces::reach_of(const Tile& tile) const {
  Reach reach;
  for (int y = std::max(tile.y0 - 1, 0); y < std::min(tile.y1 + 1, height_); ++y)
    for (int x = std::max(tile.x0 - 1, 0); x < std::min(tile.x1 + 1, width_); ++x) {
      const Point& p = at(x, y);
      if (p.flags & kKnown)
        reach.add(p);
      else
        reach.unknown = true;
    }
  return reach;
}

}  // namespace pecs::sensor::motion
