#include "motion/surfaces.h"

#include <tbb/parallel_for.h>

#include "motion/kernel.h"

namespace pecs::sensor::motion {
namespace {

constexpr float kOneSurface_px = 0.5f;  // largest change of distance between neighbours of one surface in an interval
constexpr float kSameSlope = 0.25f;     // or largest relative difference of that change between adjacent pairs

constexpr std::size_t kPlaces = 2 * kQuarters;  // channels

// Largest change of the distance between two points of a block.
float parting(const float* p, const float* q) {
  float most = 0;
  for (std::size_t c = 0; c < kPlaces; ++c) most = std::max(most, std::abs(q[c * kBlockPixels] - p[c * kBlockPixels]));
  return most;
}

// Difference of that change between the pairs of three points in a row.
float bend(const float* a, const float* b, const float* c) {
  float most = 0;
  for (std::size_t k = 0; k < kPlaces * kBlockPixels; k += kBlockPixels)
    most = std::max(most, std::abs(c[k] - 2 * b[k] + a[k]));
  return most;
}

// Larger displacements are treated as unknown.
constexpr float kMost_px = 32768;

bool is_known(const float* p) {
  float depths = 0;
  for (std::size_t c = kPlaces; c < kPathChannels; ++c) depths += p[c * kBlockPixels];
  bool near = true;  // false for NaN
  for (std::size_t c = 0; c < kPlaces; ++c) near &= std::abs(p[c * kBlockPixels]) < kMost_px;
  return near && std::isfinite(depths);
}

float length2(Vec2 v) { return v.x * v.x + v.y * v.y; }

float moved2(const Point& p) { return length2(p.moved.back()); }

// At equal depth the point that moves more is nearer: of coplanar objects it lies on the other.
bool is_nearer(const Point& a, const Point& b) { return a.z < b.z || (a.z == b.z && moved2(a) > moved2(b)); }

}  // namespace

Weights::Weights(double f) : here(static_cast<float>(1 - f)), there(static_cast<float>(f)) {
  const double t = 4 * f;
  quarters = {static_cast<float>(-t * (t - 2) * (t - 3) * (t - 4) / 6),
              static_cast<float>(t * (t - 1) * (t - 3) * (t - 4) / 4),
              static_cast<float>(-t * (t - 1) * (t - 2) * (t - 4) / 6),
              static_cast<float>(t * (t - 1) * (t - 2) * (t - 3) / 24)};
}

void Reach::add(const std::array<Vec2, kQuarters>& moved) {
  if (!any) lowest = highest = moved;
  any = true;
  Vec2 last;
  for (std::size_t q = 0; q < kQuarters; ++q) {
    const Vec2 to = moved[q];
    longest2 = std::max(longest2, kQuarters * kQuarters * length2({to.x - last.x, to.y - last.y}));
    last = to;
    moves |= to.x != 0 || to.y != 0;
    lowest[q] = {std::min(lowest[q].x, to.x), std::min(lowest[q].y, to.y)};
    highest[q] = {std::max(highest[q].x, to.x), std::max(highest[q].y, to.y)};
  }
}

Surfaces::Surfaces(int width, int height)
    : width_(width),
      height_(height),
      blocks_(static_cast<std::size_t>(tiles_x() * tiles_y()) * kPathChannels * kBlockPixels + kSpare),
      flags_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height)) {}

void Surfaces::put(int y, int rows, const float* values) {
  for (std::size_t c = 0; c < kPathChannels; ++c)
    for (int row = y; row < y + rows; ++row, values += width_)
      for (int ty = std::max(row - 1, 0) / kTileHeight; ty <= std::min(row + 1, height_ - 1) / kTileHeight; ++ty)
        for (int tx = 0; tx < tiles_x(); ++tx) {
          const Tile t = tile(ty * tiles_x() + tx);
          const int left = std::max(t.x0 - 1, 0), right = std::min(t.x1 + 1, width_);
          float* to = blocks_.data() +
                      (static_cast<std::size_t>(ty * tiles_x() + tx) * kPathChannels + c) * kBlockPixels +
                      block_place(left - t.x0, row - t.y0);
          for (int x = left; x < right; ++x, ++to) *to = c < kPlaces ? values[x] : std::min(values[x], kFar);
        }
}

void Surfaces::close() {
  const int tiles = tiles_x() * tiles_y(), width = width_, height = height_;
  tbb::parallel_for(0, tiles, [&](int i) { link(i); });

  // Passes: each one uses the flags that the one before set at the neighbours.
  std::vector<std::uint16_t> found(flags_.size());
  const auto add = [&](const auto& value) {
    tbb::parallel_for(0, height, [&](int y) {
      for (int x = 0; x < width; ++x) found[static_cast<std::size_t>(y) * width + x] = value(x, y);
    });
    for (std::size_t i = 0; i < flags_.size(); ++i) flags_[i] |= found[i];
  };
  add([&](int x, int y) {
    const std::int32_t i = y * width_ + x;
    const bool left = x > 0 && flags(i - 1) & kRight, up = y > 0 && flags(i - width_) & kDown;
    return static_cast<std::uint16_t>((left ? kLeft : 0) | (up ? kUp : 0));
  });
  add([&](int x, int y) { return mixed_of(x, y); });
  add([&](int x, int y) { return near_mixed_of(x, y); });

  reach_.resize(static_cast<std::size_t>(tiles));
  tbb::parallel_for(0, tiles, [&](int i) { reach_[static_cast<std::size_t>(i)] = reach_of(i); });
  const float longest2 = std::ranges::max(reach_, {}, &Reach::longest2).longest2;
  longest_ = std::min<double>(std::sqrt(longest2), std::hypot(width_, height_));
}

// kKnown, kRight and kDown of a tile.
void Surfaces::link(int index) {
  const Tile t = tile(index);
  const int count = t.x1 - t.x0;
  for (int y = t.y0; y < t.y1; ++y) {
    std::uint16_t* row = flags_.data() + static_cast<std::ptrdiff_t>(y) * width_ + t.x0;
    const float* p = block(index) + block_place(0, y - t.y0);
    for (int x = 0; x < count; ++x) row[x] = is_known(p + x) ? kKnown : 0;
    for (int x = 0; x < count; ++x)
      if (parting(p + x, p + x + 1) <= kOneSurface_px) row[x] |= kRight;
    for (int x = 0; x < count; ++x)
      if (parting(p + x, p + x + kBlockWidth) <= kOneSurface_px) row[x] |= kDown;
    for (int x = 0; x < count; ++x) {
      if ((row[x] & (kRight | kDown)) != (kRight | kDown))
        for (const std::uint16_t flag : {kRight, kDown}) row[x] |= links_of(t.x0 + x, y, flag);
      if (t.x0 + x + 1 >= width_ || !(row[x] & kKnown) || !is_known(p + x + 1))
        row[x] &= static_cast<std::uint16_t>(~kRight);
      if (y + 1 >= height_ || !(row[x] & kKnown) || !is_known(p + x + kBlockWidth))
        row[x] &= static_cast<std::uint16_t>(~kDown);
    }
  }
}

// `flag` if the distance of a pixel and its neighbour changes as that of the adjacent pairs does.
std::uint16_t Surfaces::links_of(int x, int y, std::uint16_t flag) const {
  const bool right = flag == kRight;
  const int along = right ? x : y, size = right ? width_ : height_;
  if (along < 1 || along + 2 >= size) return 0;
  const std::int32_t here = y * width_ + x, step = right ? 1 : width_;
  const float *a = where(here - step), *b = where(here), *c = where(here + step), *d = where(here + 2 * step);
  const float off = kSameSlope * parting(b, c);
  return bend(a, b, c) <= off && bend(b, c, d) <= off ? flag : std::uint16_t{0};
}

std::uint16_t Surfaces::near_mixed_of(int x, int y) const {
  const std::int32_t here = y * width_ + x;
  std::uint16_t any = flags(here);
  for (int dy = y > 0 ? -1 : 0; dy <= (y + 1 < height_ ? 1 : 0); ++dy)
    for (int dx = x > 0 ? -1 : 0; dx <= (x + 1 < width_ ? 1 : 0); ++dx) any |= flags(here + dy * width_ + dx);
  if (!(any & kMixedPixel)) return 0;
  bool mixed = flags(here) & kMixedPixel;
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx)
      if ((dx || dy) && joined(here, dx, dy)) mixed |= (flags(here + dy * width_ + dx) & kMixedPixel) != 0;
  return mixed ? kNearMixed : 0;
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

// kMixedPixel and the occluder of a pixel at an occlusion boundary, else 0. The occluder is the nearest neighbour that
// shares a side, if there is one, else the nearest diagonal one.
std::uint16_t Surfaces::mixed_of(int x, int y) const {
  const std::int32_t here = y * width_ + x;
  if (!(flags(here) & kKnown)) return 0;
  constexpr std::uint16_t kAll = kRight | kLeft | kDown | kUp;
  const bool inside = x > 0 && y > 0 && x + 1 < width_ && y + 1 < height_;
  if (inside && (flags(here) & kAll) == kAll && (flags(here - 1) & kAll) == kAll && (flags(here + 1) & kAll) == kAll)
    return 0;
  const Point p = at(here);
  Point occluder{};
  int best = 0;
  std::uint16_t boundary = 0;
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx) {
      if ((dx == 0 && dy == 0) || x + dx < 0 || x + dx >= width_ || y + dy < 0 || y + dy >= height_) continue;
      const std::int32_t there = here + dy * width_ + dx;
      const Point q = at(there);
      if (!(flags(there) & kKnown) || !is_nearer(q, p) || joined(here, dx, dy)) continue;
      const int rank = dx == 0 || dy == 0 ? 2 : 1;
      if (rank < best || (rank == best && !is_nearer(q, occluder))) continue;
      best = rank;
      occluder = q;
      boundary = static_cast<std::uint16_t>(kMixedPixel | ((dy + 1) * 3 + dx + 1) << kOccluderShift);
    }
  return boundary;
}

// With a margin of one pixel, whose motion may be that of boundary pixels of the block.
Reach Surfaces::reach_of(int index) const {
  const Tile t = tile(index);
  Reach reach;
  for (int y = std::max(t.y0 - 1, 0); y < std::min(t.y1 + 1, height_); ++y) {
    const float* row = block(index) + block_place(-t.x0, y - t.y0);
    for (int x = std::max(t.x0 - 1, 0); x < std::min(t.x1 + 1, width_); ++x) {
      const std::uint16_t mine = flags(y * width_ + x);
      reach.mixed |= (mine & kMixedPixel) != 0;
      if (mine & kKnown)
        reach.add(moved(row + x));
      else
        reach.unknown = true;
    }
  }
  return reach;
}

}  // namespace pecs::sensor::motion
