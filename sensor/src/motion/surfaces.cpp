#include "motion/surfaces.h"

#include <tbb/parallel_for.h>

#include "motion/kernel.h"

namespace pecs::sensor::motion {
namespace {

constexpr float kOneSurface_px = 0.5f;  // that neighbours of one surface may part within an interval
constexpr float kSameSlope = 0.25f;     // or: how much their distance may differ from that of the next neighbours

// The channels of a keyframe's motion as they come.
struct Raw {
  const float* channels;
  std::ptrdiff_t pixels;
  float value(std::size_t c, std::ptrdiff_t i) const { return channels[static_cast<std::ptrdiff_t>(c) * pixels + i]; }
  bool is_known(std::ptrdiff_t i) const {
    float sum = 0;
    for (std::size_t c = 0; c < 6; ++c) sum += c < 4 ? value(c, i) : std::min(value(c, i), kFar);
    return std::isfinite(sum);
  }
  // How far two points part, at the middle or at the end.
  float parting(std::ptrdiff_t i, std::ptrdiff_t k) const {
    float most = 0;
    for (std::size_t c = 0; c < 4; ++c) most = std::max(most, std::abs(value(c, k) - value(c, i)));
    return most;
  }
  // How much that differs from point to point of three in a row.
  float bend(std::ptrdiff_t i, std::ptrdiff_t step) const {
    float most = 0;
    for (std::size_t c = 0; c < 4; ++c)
      most = std::max(most, std::abs(value(c, i + step) - 2 * value(c, i) + value(c, i - step)));
    return most;
  }
};

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

Surfaces::Surfaces(const float* channels, int width, int height) : width_(width), height_(height) {
  const int tiles = tiles_x() * tiles_y();
  blocks_.resize(static_cast<std::size_t>(tiles) * 6 * kBlockPixels + kSpare);
  flags_.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  tbb::parallel_for(0, tiles, [&](int i) { fill_block(i, channels); });
  std::vector<float> longest(static_cast<std::size_t>(height));
  tbb::parallel_for(0, height, [&](int y) { longest[static_cast<std::size_t>(y)] = begin_row(channels, y); });
  longest_ = *std::ranges::max_element(longest);

  // In passes, each of which looks at what the one before found of the neighbours.
  std::vector<std::uint16_t> found(flags_.size());
  const auto add = [&](const auto& value) {
    tbb::parallel_for(0, height, [&](int y) {
      for (int x = 0; x < width; ++x) found[static_cast<std::size_t>(y * width + x)] = value(x, y);
    });
    for (std::size_t i = 0; i < flags_.size(); ++i) flags_[i] |= found[i];
  };
  add([&](int x, int y) {
    const std::int32_t i = y * width_ + x;
    const bool left = x > 0 && flags(i - 1) & kRight, up = y > 0 && flags(i - width_) & kDown;
    return static_cast<std::uint16_t>((left ? kLeft : 0) | (up ? kUp : 0));
  });
  add([&](int x, int y) { return rim_of(x, y); });
  add([&](int x, int y) { return mixed_of(x, y); });

  reach_.resize(static_cast<std::size_t>(tiles));
  tbb::parallel_for(0, tiles, [&](int i) { reach_[static_cast<std::size_t>(i)] = reach_of(i); });
}

// kKnown, kRight and kDown of a row; returns its longest path. Of a row b c of points: they are of one surface if they
// hardly part, or as much as the neighbours beyond do.
float Surfaces::begin_row(const float* channels, int y) {
  const Raw raw{channels, static_cast<std::ptrdiff_t>(width_) * height_};
  const std::ptrdiff_t first = static_cast<std::ptrdiff_t>(y) * width_;
  std::uint16_t* row = flags_.data() + first;
  float longest2 = 0;
  for (std::ptrdiff_t x = 0; x < width_; ++x) row[x] = raw.is_known(first + x) ? kKnown : 0;
  for (std::ptrdiff_t x = 0; x < width_; ++x) {
    const auto value = [&](std::size_t c) { return raw.value(c, first + x); };
    const float a2 = value(0) * value(0) + value(1) * value(1), dx = value(2) - value(0), dy = value(3) - value(1);
    const float path2 = 2 * (a2 + dx * dx + dy * dy);  // at least the squared sum of both halves
    longest2 = row[x] && path2 > longest2 ? path2 : longest2;
  }
  const auto link = [&](std::ptrdiff_t step, std::uint16_t flag, std::ptrdiff_t count, int before, int after,
                        int size) {
    for (std::ptrdiff_t x = 0; x < count; ++x)
      if (raw.parting(first + x, first + x + step) <= kOneSurface_px) row[x] |= flag;
    for (std::ptrdiff_t x = 0; x < count; ++x) {
      const std::ptrdiff_t i = first + x;
      const int at = flag == kRight ? static_cast<int>(x) : y;
      if (row[x] & flag || at < before || at + after >= size) continue;
      const float off = kSameSlope * raw.parting(i, i + step);
      if (raw.bend(i, step) <= off && raw.bend(i + step, step) <= off) row[x] |= flag;
    }
    for (std::ptrdiff_t x = 0; x < count; ++x)
      if (row[x] & flag && !(row[x] & kKnown && raw.is_known(first + x + step)))
        row[x] = static_cast<std::uint16_t>(row[x] & ~flag);
  };
  link(1, kRight, width_ - 1, 1, 2, width_);
  if (y + 1 < height_) link(width_, kDown, width_, 1, 2, height_);
  return std::sqrt(longest2);
}

std::uint16_t Surfaces::mixed_of(int x, int y) const {
  const std::int32_t here = y * width_ + x;
  std::uint16_t any = flags(here);
  for (int dy = y > 0 ? -1 : 0; dy <= (y + 1 < height_ ? 1 : 0); ++dy)
    for (int dx = x > 0 ? -1 : 0; dx <= (x + 1 < width_ ? 1 : 0); ++dx) any |= flags(here + dy * width_ + dx);
  if (!(any & kSoiled)) return 0;
  bool soiled = flags(here) & kSoiled;
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx)
      if ((dx || dy) && joined(here, dx, dy)) soiled |= (flags(here + dy * width_ + dx) & kSoiled) != 0;
  return soiled ? kMixed : 0;
}

void Surfaces::fill_block(int index, const float* channels) {
  const Tile t = tile(index);
  const int left = std::max(t.x0 - 1, 0), right = std::min(t.x1 + 1, width_);
  float* block = blocks_.data() + static_cast<std::size_t>(index) * 6 * kBlockPixels;
  for (std::size_t c = 0; c < 6; ++c)
    for (int y = std::max(t.y0 - 1, 0); y < std::min(t.y1 + 1, height_); ++y) {
      const float* from = channels + (c * static_cast<std::size_t>(height_) + static_cast<std::size_t>(y)) *
                                         static_cast<std::size_t>(width_);
      float* to = block + c * kBlockPixels + (y - t.y0 + 1) * kBlockWidth + left - t.x0 + 1;
      for (int x = left; x < right; ++x, ++to) *to = c < 4 ? from[x] : std::min(from[x], kFar);
    }
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
Reach Surfaces::reach_of(int index) const {
  const Tile t = tile(index);
  Reach reach;
  for (int y = std::max(t.y0 - 1, 0); y < std::min(t.y1 + 1, height_); ++y) {
    const float* row = block(index) + (y - t.y0 + 1) * kBlockWidth - t.x0 + 1;
    for (int x = std::max(t.x0 - 1, 0); x < std::min(t.x1 + 1, width_); ++x) {
      const std::uint16_t mine = flags(y * width_ + x);
      reach.soiled |= (mine & kSoiled) != 0;
      if (mine & kKnown)
        reach.add({row[x], row[x + kBlockPixels], row[x + 2 * kBlockPixels], row[x + 3 * kBlockPixels], 0, 0});
      else
        reach.unknown = true;
    }
  }
  return reach;
}

}  // namespace pecs::sensor::motion
