#include "motion/landing.h"

#include <algorithm>

namespace pecs::sensor::motion {
namespace {

// Slopes of displacement and depth along a point's surface, per pixel.
struct Slopes {
  Vec2 by_x, by_y;
  float z_by_x = 0, z_by_y = 0;
};

// Central differences where both neighbours share the surface, else one-sided. at: the point, as Surfaces::where.
Slopes slopes_of(const Weights& w, const float* at, std::uint16_t flags) {
  Slopes out;
  const auto along = [&](std::uint16_t ahead, std::uint16_t behind, int step, Vec2& slope, float& z_slope) {
    const bool next = flags & ahead, last = flags & behind;
    if (!next && !last) return;
    const Point a = Surfaces::at(last ? at - step : at), b = Surfaces::at(next ? at + step : at);
    const float per = next && last ? 0.5f : 1.0f;
    const Vec2 d0 = w.path(a), d1 = w.path(b);
    slope = {per * (d1.x - d0.x), per * (d1.y - d0.y)};
    z_slope = per * (w.depth(b) - w.depth(a));
  };
  along(kRight, kLeft, 1, out.by_x, out.z_by_x);
  along(kDown, kUp, kBlockWidth, out.by_y, out.z_by_y);
  return out;
}

// The surface of pixel `of`, continued to its neighbour (dx, dy).
Patch continued(const Surfaces& from, const Weights& w, std::int32_t of, int dx, int dy) {
  const float* at = from.where(of);
  const Slopes s = slopes_of(w, at, from.flags(of));
  const Point p = Surfaces::at(at);
  const Vec2 d = w.path(p), pixel = from.position(of);
  const auto ox = static_cast<float>(dx), oy = static_cast<float>(dy);
  const Vec2 in{pixel.x + ox, pixel.y + oy};
  const Vec2 now{in.x + d.x + s.by_x.x * ox + s.by_y.x * oy, in.y + d.y + s.by_x.y * ox + s.by_y.y * oy};
  return {of + dy * from.width() + dx, in, now, s.by_x, s.by_y, w.depth(p), s.z_by_x, s.z_by_y};
}

}  // namespace

VisiblePoint Patch::at(float x, float y) const {
  const float rx = x - now.x, ry = y - now.y;
  float xx = 1 + by_x.x, xy = by_y.x, yx = by_x.y, yy = 1 + by_y.y;
  float det = xx * yy - xy * yx;
  if (!(det > 0.1f)) xx = yy = det = 1, xy = yx = 0;  // the surface turns away
  const float u = (yy * rx - xy * ry) / det, v = (xx * ry - yx * rx) / det;
  return {index, in.x + u, in.y + v, z + z_by_x * u + z_by_y * v};
}

Patch patch_of(const Surfaces& from, const Weights& w, std::int32_t index) { return continued(from, w, index, 0, 0); }

Patch boundary_of(const Surfaces& from, const Weights& w, std::int32_t index) {
  const auto [dx, dy] = from.occluder(index);
  return continued(from, w, index + dy * from.width() + dx, -dx, -dy);
}

// Results of land_run for a row.
struct Landing::Run {
  static constexpr std::size_t kMost = kTileWidth + kSpare;
  std::int32_t column[kMost], row[kMost];
  float u[kMost], v[kMost], depth[kMost];
};

// Lands the part of a keyframe's tile that may reach this tile.
void Landing::land_part(const Surfaces& from, const Weights& w, int tile, const Tile& part) {
  const Tile source = from.tile(tile);
  const auto [x0, y0, x1, y1] = part;
  const auto above = static_cast<std::size_t>(y0 - source.y0) * kBlockWidth;  // the row above the part's first
  paths({from.block(tile) + above, kBlockPixels, w.quarters, w.here, w.there,
         static_cast<std::size_t>(y1 - y0 + 2) * kBlockWidth, paths_[0] + above, paths_[1] + above, paths_[2] + above});
  Run run;
  std::uint16_t flags[Run::kMost] = {};
  for (int y = y0; y < y1; ++y) {
    const std::int32_t first = y * from.width() + x0;
    for (int x = x0; x < x1; ++x) flags[x - x0] = from.flags(first + x - x0);
    const std::ptrdiff_t at = block_place(x0 - source.x0, y - source.y0);
    land_run({paths_[0] + at, paths_[1] + at, paths_[2] + at, kBlockWidth, flags, static_cast<float>(x0),
              static_cast<float>(y), static_cast<std::size_t>(x1 - x0), run.column, run.row, run.u, run.v, run.depth});
    for (int i = 0; i < x1 - x0; ++i) {
      const auto column = static_cast<unsigned>(run.column[i] - x0_), row = static_cast<unsigned>(run.row[i] - y0_);
      if (column >= kWidth || row >= kHeight) continue;
      const std::size_t k = row * kWidth + column;
      if (!(run.depth[i] < points.z[k])) continue;  // the first of equal depths wins
      points.z[k] = run.depth[i];
      points.u[k] = run.u[i];
      points.v[k] = run.v[i];
      points.index[k] = first + i;
    }
  }
}

void Landing::land_boundaries(const Surfaces& from, const Weights& w, const Tile& part) {
  const auto [x0, y0, x1, y1] = part;
  for (int y = y0; y < y1; ++y)
    for (int x = x0; x < x1; ++x) {
      const std::int32_t index = y * from.width() + x;
      if (!(from.flags(index) & kMixedPixel)) continue;
      const Patch patch = boundary_of(from, w, index);
      const float column = std::floor(patch.now.x + 0.5f), row = std::floor(patch.now.y + 0.5f);
      const int cx = static_cast<int>(column) - x0_, cy = static_cast<int>(row) - y0_;
      if (cx < 0 || cx >= kWidth || cy < 0 || cy >= kHeight) continue;
      if (!has_boundaries) {
        std::ranges::fill(boundaries.z, kNothing);
        std::ranges::fill(boundaries.index, kNone);
      }
      has_boundaries = true;
      const auto k = static_cast<std::size_t>(cy) * kWidth + cx;
      const float z = patch.at(column, row).z;
      if (!(z < boundaries.z[k])) continue;
      boundaries.z[k] = z, boundaries.index[k] = index, boundaries.patch[k] = patch;
    }
}

void Landing::land(const Surfaces& from, const Weights& w, const Tile& tile, std::span<const std::int32_t> tiles) {
  x0_ = tile.x0 - 1, y0_ = tile.y0 - 1;
  has_boundaries = false;
  std::ranges::fill(points.z, kNothing);
  std::ranges::fill(points.u, 0.0f);
  std::ranges::fill(points.v, 0.0f);
  std::ranges::fill(points.index, kNone);
  for (const std::int32_t t : tiles) {
    const Tile source = from.tile(t);
    const Vec2 least = from.reach(t).least(w), most = from.reach(t).most(w);
    // Pixels that may land here. A boundary pixel moves as its neighbour does, up to the slope.
    const auto first = [](int edge, float d) { return static_cast<int>(std::floor(static_cast<float>(edge) - d)) - 2; };
    const auto end = [](int edge, float d) { return static_cast<int>(std::ceil(static_cast<float>(edge) - d)) + 2; };
    const int x0 = std::max(source.x0, first(x0_, most.x)), x1 = std::min(source.x1, end(x0_ + kWidth, least.x));
    const int y0 = std::max(source.y0, first(y0_, most.y)), y1 = std::min(source.y1, end(y0_ + kHeight, least.y));
    if (x0 >= x1 || y0 >= y1) continue;
    land_part(from, w, t, {x0, y0, x1, y1});
    if (from.reach(t).mixed) land_boundaries(from, w, {x0, y0, x1, y1});
  }
}

}  // namespace pecs::sensor::motion
