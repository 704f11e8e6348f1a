#include "motion/view.h"

#include <cmath>

namespace pecs::sensor::motion {
namespace {

constexpr float kSameDepth = 0.05f;  // largest relative difference of the depths of one point in both keyframes

// Whether the surface extends from the pixel to the position: half a pixel, or up to a neighbour on the same surface.
bool covers(const Surfaces& from, const VisiblePoint& seen, bool is_boundary) {
  const std::uint16_t flags = is_boundary ? 0 : from.flags(seen.index);
  const auto within = [&](float d, std::uint16_t ahead, std::uint16_t behind) {
    return std::abs(d) <= (flags & (d > 0 ? ahead : behind) ? 1.0f : 0.51f);
  };
  const Vec2 point = from.position(seen.index);
  return within(seen.u - point.x, kRight, kLeft) && within(seen.v - point.y, kDown, kUp);
}

// Whether two pixels of a keyframe are one, or neighbours on one surface.
bool on_one_surface(const Surfaces& from, std::int32_t a, std::int32_t b) {
  const int step = b - a, dy = step > 1 ? 1 : step < -1 ? -1 : 0, dx = step - dy * from.width();
  return step == 0 || (std::abs(dx) <= 1 && from.joined(a, dx, dy));
}

template <class Visit>
void around(std::size_t slot, const Visit& visit) {
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx) visit(slot + static_cast<std::size_t>(dy * Landing::kWidth + dx));
}

}  // namespace

void View::look(const Weights& w, const Tile& tile, std::span<const std::int32_t> near) {
  weights = w;
  landing.land(from, weights, tile, near);
  Landing::Layer& points = landing.points;
  struct Found {
    std::size_t slot;
    VisiblePoint seen;
  };
  std::vector<Found> found;
  std::uint8_t close[kTileWidth + kSpare];
  for (int row = 0; row < tile.y1 - tile.y0; ++row) {
    const std::size_t first = Landing::slot(0, row);
    contested(points.z + first, Landing::kWidth, Landing::kNothing * 0.75f, kTileWidth, close);
    for (int column = 0; column < tile.x1 - tile.x0; ++column) {
      if (!close[column]) continue;
      const std::size_t slot = first + static_cast<std::size_t>(column);
      const auto x = static_cast<float>(tile.x0 + column), y = static_cast<float>(tile.y0 + row);
      VisiblePoint best = points.seen(slot);
      if (!best.is()) best.z = Landing::kNothing;
      around(slot, [&](std::size_t k) {
        if (k == slot || points.z[k] >= best.z) return;  // nothing there, or farther
        if (best.is() && on_one_surface(from, best.index, points.index[k])) return;
        const VisiblePoint other = patch_of(from, weights, points.index[k]).at(x, y);
        if (other.z < best.z && covers(from, other, false)) best = other;
      });
      if (best.is()) found.push_back({slot, best});
    }
  }
  for (const auto& [slot, seen] : found)
    points.z[slot] = seen.z, points.u[slot] = seen.u, points.v[slot] = seen.v, points.index[slot] = seen.index;
}

VisiblePoint View::boundary(int column, int row, int x, int y) const {
  VisiblePoint best;
  around(Landing::slot(column, row), [&](std::size_t k) {
    if (landing.boundaries.index[k] == kNone) return;
    const VisiblePoint seen = landing.boundaries.patch[k].at(static_cast<float>(x), static_cast<float>(y));
    if (seen.z < best.z && covers(from, seen, true)) best = seen;
  });
  return best;
}

bool View::is_before(const VisiblePoint& boundary, const VisiblePoint& other) const {
  if (!other.is()) return true;
  const float behind = weights.depth(from.at(boundary.index));
  return other.z > std::min(0.5f * (boundary.z + behind), 1.5f * boundary.z);
}

void drop_hidden(Landing::Layer& a, Landing::Layer& b) {
  for (std::size_t i = 0; i < Landing::kSlots; ++i) {
    const float apart = a.z[i] - b.z[i];
    const bool differ = std::abs(apart) > kSameDepth * std::min(a.z[i], b.z[i]);
    if (a.index[i] == kNone || b.index[i] == kNone) continue;
    if (differ) (apart > 0 ? a : b).index[i] = kNone;
  }
}

std::vector<BoundaryPixel> boundaries_of(const Tile& tile, const View* first, const View* second) {
  const View* const views[2] = {first, second};
  std::vector<BoundaryPixel> boundaries;
  std::uint8_t marked[Landing::kSlots] = {};
  for (const View* view : views)
    if (view && view->landing.has_boundaries)
      for (std::size_t k = 0; k < Landing::kSlots; ++k)
        if (view->landing.boundaries.index[k] != kNone)
          for (int dy = -1; dy <= 1; ++dy)
            for (int dx = -1; dx <= 1; ++dx)
              if (const std::size_t at = k + static_cast<std::size_t>(dy * Landing::kWidth + dx); at < Landing::kSlots)
                marked[at] = 1;
  for (int row = 0; row < tile.y1 - tile.y0; ++row)
    for (int column = 0; column < tile.x1 - tile.x0; ++column) {
      const std::size_t slot = Landing::slot(column, row);
      if (!marked[slot]) continue;
      BoundaryPixel boundary{column, row, {}};
      for (int k = 0; k < 2; ++k) {
        if (!views[k] || !views[k]->landing.has_boundaries) continue;
        const VisiblePoint seen = views[k]->boundary(column, row, tile.x0 + column, tile.y0 + row);
        if (!seen.is()) continue;
        bool before = true;
        for (const View* view : views) before &= !view || views[k]->is_before(seen, view->landing.points.seen(slot));
        if (before) boundary.seen[k] = seen;
      }
      if (boundary.seen[0].is() || boundary.seen[1].is()) boundaries.push_back(boundary);
    }
  return boundaries;
}

}  // namespace pecs::sensor::motion
