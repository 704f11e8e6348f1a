#include "motion/landing.h"

#include <algorithm>

namespace pecs::sensor::motion {
namespace {

// Slopes of displacement and depth on the surface of the point: central differences where both neighbours belong to it.
void slopes(const Surfaces& from, const Weights& w, std::int32_t index, Place& place) {
  const Point& p = from.at(index);
  const auto along = [&](std::uint32_t ahead, std::uint32_t behind, int step, Vec2& slope, float& depth_slope) {
    const bool next = p.flags & ahead, last = p.flags & behind;
    if (!next && !last) return;
    const Point &b = next ? from.at(index + step) : p, &a = last ? from.at(index - step) : p;
    const float per = next && last ? 0.5f : 1.0f;
    const Vec2 d1 = w.path(b), d0 = w.path(a);
    slope = {per * (d1.x - d0.x), per * (d1.y - d0.y)};
    const float dz = per * (w.depth(b) - w.depth(a));
    depth_slope = std::isfinite(dz) ? dz : 0;
  };
  along(kRight, kLeft, 1, place.by_x, place.z_by_x);
  along(kDown, kUp, from.width(), place.by_y, place.z_by_y);
}

}  // namespace

Place place_of(const Surfaces& from, const Weights& w, std::int32_t code) {
  const std::int32_t index = code >> 1;
  const bool rim = code & 1;
  int dx = 0, dy = 0;
  if (rim) {
    const auto owner = static_cast<int>(from.at(index).flags >> kOwnerShift);
    dx = owner % 3 - 1, dy = owner / 3 - 1;
  }
  const std::int32_t of = index + dy * from.width() + dx;
  Place place;
  slopes(from, w, of, place);
  const Vec2 d = w.path(from.at(of));
  const auto x = static_cast<float>(index % from.width()), y = static_cast<float>(index / from.width());
  const auto fx = static_cast<float>(dx), fy = static_cast<float>(dy);
  place.at = {x + (d.x - place.by_x.x * fx - place.by_y.x * fy), y + (d.y - place.by_x.y * fx - place.by_y.y * fy)};
  place.z = w.depth(from.at(of));
  return place;
}

void Landing::put(Vec2 at, float z, std::int32_t code) {
  const int column = static_cast<int>(std::floor(at.x + 0.5f)) - x0_,
            row = static_cast<int>(std::floor(at.y + 0.5f)) - y0_;
  if (column < 0 || column >= kWidth || row < 0 || row >= kHeight) return;
  const auto k = static_cast<std::size_t>(row * kWidth + column);
  if (codes_[k] != kNone && !(z < depths_[k])) return;  // the first of equals
  codes_[k] = code;
  depths_[k] = z;
}

void Landing::land(const Surfaces& from, const Weights& w, const Tile& tile, std::span<const std::int32_t> tiles) {
  x0_ = tile.x0 - 1, y0_ = tile.y0 - 1;
  std::ranges::fill(codes_, kNone);
  std::ranges::fill(depths_, std::numeric_limits<float>::infinity());
  for (const std::int32_t t : tiles) {
    const Tile source = from.tile(t);
    const Vec2 least = from.reach(t).least(w), most = from.reach(t).most(w);
    // Pixels that may land here; a rim's motion is its neighbour's and may differ by its slope.
    const auto first = [](int edge, float d) { return static_cast<int>(std::floor(static_cast<float>(edge) - d)) - 3; };
    const auto end = [](int edge, float d) { return static_cast<int>(std::ceil(static_cast<float>(edge) - d)) + 3; };
    const int x0 = std::max(source.x0, first(x0_, most.x)), x1 = std::min(source.x1, end(x0_ + kWidth, least.x));
    const int y0 = std::max(source.y0, first(y0_, most.y)), y1 = std::min(source.y1, end(y0_ + kHeight, least.y));
    for (int y = y0; y < y1; ++y)
      for (int x = x0; x < x1; ++x) {
        const std::int32_t index = y * from.width() + x;
        const Point& p = from.at(index);
        if (!(p.flags & kKnown)) continue;
        const Vec2 d = w.path(p);
        put({static_cast<float>(x) + d.x, static_cast<float>(y) + d.y}, w.depth(p), index * 2);
        if (p.flags & kSoiled) {
          const Place place = place_of(from, w, index * 2 + 1);
          put(place.at, place.z * 1.0005f, index * 2 + 1);  // behind the surface itself
        }
      }
  }
}

}  // namespace pecs::sensor::motion
