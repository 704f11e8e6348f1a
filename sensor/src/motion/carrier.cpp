#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "motion/landing.h"
#include "motion/sample.h"
#include "motion/surfaces.h"
#include "pecs/error.h"
#include "pecs/sensor/motion.h"

namespace pecs::sensor {
namespace motion {
namespace {

constexpr float kSameDepth = 0.05f;  // of points that both keyframes show: relative difference
constexpr float kRim_px = 0.25f;     // of a pixel beyond its centre that a nearer surface claims
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

// Where a keyframe shows what is at a pixel at the instant.
struct Seen {
  std::int32_t code = Landing::kNone;  // of the point beside it
  Vec2 at;                             // in the keyframe
  float z = 0;
};

// The position on the point's surface that is at (x, y): its place, linear around it.
Seen solve(const Surfaces& from, const Weights& w, std::int32_t code, float x, float y) {
  const Place p = place_of(from, w, code);
  const float rx = x - p.at.x, ry = y - p.at.y;
  float xx = 1 + p.by_x.x, xy = p.by_y.x, yx = p.by_x.y, yy = 1 + p.by_y.y;
  float det = xx * yy - xy * yx;
  if (!(det > 0.1f)) xx = yy = det = 1, xy = yx = 0;  // the surface turns away
  const float u = (yy * rx - xy * ry) / det, v = (xx * ry - yx * rx) / det;
  const std::int32_t index = code >> 1;
  return {code,
          {static_cast<float>(index % from.width()) + u, static_cast<float>(index / from.width()) + v},
          p.z + p.z_by_x * u + p.z_by_y * v};
}

// Whether the surface reaches from the point to that position: half a pixel, or to the neighbour that belongs to it.
bool covers(const Surfaces& from, const Seen& seen) {
  const std::int32_t index = seen.code >> 1;
  const std::uint32_t flags = seen.code & 1 ? 0 : from.at(index).flags;
  const float u = seen.at.x - static_cast<float>(index % from.width()),
              v = seen.at.y - static_cast<float>(index / from.width());
  if (seen.code & 1) {  // a rim hardly beyond the pixel's centre: there it holds little of the nearer surface
    const auto owner = static_cast<int>(from.at(index).flags >> kOwnerShift);
    const auto dx = static_cast<float>(owner % 3 - 1), dy = static_cast<float>(owner / 3 - 1);
    if (dx * u + dy * v < -kRim_px) return false;
  }
  const auto within = [&](float d, std::uint32_t ahead, std::uint32_t behind) {
    return std::abs(d) <= (flags & (d > 0 ? ahead : behind) ? 1.0f : 0.51f);
  };
  return within(u, kRight, kLeft) && within(v, kDown, kUp);
}

Seen find(const Surfaces& from, const Weights& w, const Landing& landing, int x, int y) {
  const auto fx = static_cast<float>(x), fy = static_cast<float>(y);
  const std::int32_t here = landing.code(x, y);
  const float depth = landing.depth(x, y) * 0.99f;
  Seen best;
  if (here != Landing::kNone) best = solve(from, w, here, fx, fy);
  const bool is_rim = here != Landing::kNone && (here & 1);
  if (is_rim && !covers(from, best)) best = {};
  bool contested = here == Landing::kNone || is_rim;
  for (int dy = -1; dy <= 1 && !contested; ++dy)
    for (int dx = -1; dx <= 1; ++dx) contested |= landing.depth(x + dx, y + dy) < depth;
  if (!contested) return best;
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx) {
      const std::int32_t code = landing.code(x + dx, y + dy);
      if (code == Landing::kNone || (dx == 0 && dy == 0)) continue;
      const Seen other = solve(from, w, code, fx, fy);
      if (covers(from, other) && (best.code == Landing::kNone || other.z < best.z)) best = other;
    }
  return best;
}

struct Light {
  float value = kNaN;
  bool soiled = false;  // by a nearer surface
};

// Beside a nearer surface: of the four pixels around those that show this surface and no other.
Light own_light(const Surfaces& from, const float* plane, const Seen& seen) {
  const std::int32_t index = seen.code >> 1;
  const int px = index % from.width(), py = index / from.width();
  const float u = seen.at.x - static_cast<float>(px), v = seen.at.y - static_cast<float>(py);
  const Point& p = from.at(index);
  const int dx = u < 0 ? -1 : 1, dy = v < 0 ? -1 : 1;
  const std::uint32_t to_x = dx > 0 ? kRight : kLeft, to_y = dy > 0 ? kDown : kUp;
  const bool has_x = p.flags & to_x, has_y = p.flags & to_y;
  const float fu = std::min(std::abs(u), 1.0f), fv = std::min(std::abs(v), 1.0f);
  float sum = 0, weight = 0;
  const auto add = [&](bool is_there, int ox, int oy, float w) {
    if (!is_there || w == 0) return;
    const Point& q = from.at(px + ox, py + oy);
    const float value = plane[static_cast<std::ptrdiff_t>(py + oy) * from.width() + px + ox];
    if (q.flags & kSoiled || !std::isfinite(value)) return;
    sum += w * value;
    weight += w;
  };
  add(true, 0, 0, (1 - fu) * (1 - fv));
  add(has_x, dx, 0, fu * (1 - fv));
  add(has_y, 0, dy, (1 - fu) * fv);
  add((has_x && (from.at(px + dx, py).flags & to_y)) || (has_y && (from.at(px, py + dy).flags & to_x)), dx, dy,
      fu * fv);
  if (weight > 0.05f) return {sum / weight, false};
  return {plane[index], true};
}

Light light_of(const Surfaces& from, const float* plane, const Seen& seen) {
  if (seen.code == Landing::kNone) return {};
  const bool rim = seen.code & 1;
  if (!rim && from.at(seen.code >> 1).flags & kMixed) return own_light(from, plane, seen);
  return {cubic(plane, from.width(), from.height(), seen.at.x, seen.at.y), false};
}

// a^(1-s) b^s; linear where one is dark.
float between(float a, float b, float s) {
  if (a == b) return a;
  if (!std::isfinite(a)) return b;
  if (!std::isfinite(b)) return a;
  if (!(a > 0 && b > 0)) return (1 - s) * a + s * b;
  return a * std::exp(s * std::log(b / a));
}

// Both keyframes' light at a pixel; `at`: its own in both.
float blend(const Seen& a, const Light& la, const Seen& b, const Light& lb, float at_a, float at_b, float s) {
  const bool has_a = std::isfinite(la.value), has_b = std::isfinite(lb.value);
  if (!has_a && !has_b) return between(at_a, at_b, s);
  if (!has_a || !has_b) return has_a ? la.value : lb.value;
  const float nearer = std::min(a.z, b.z), apart = std::abs(a.z - b.z);
  if (apart > kSameDepth * nearer) return a.z < b.z ? la.value : lb.value;
  if (la.soiled != lb.soiled) return la.soiled ? lb.value : la.value;
  return between(la.value, lb.value, s);
}

}  // namespace
}  // namespace motion

using namespace motion;

struct Carrier::Interval {
  Surfaces first, second;
  // Of each tile: tiles of either keyframe whose points may come over it; `still`: nothing moves there.
  struct Near {
    std::vector<std::int32_t> first, second;
    bool still = true;
  };
  std::vector<Near> near{};

  void find_near();
  void tile(std::span<const float* const> a, std::span<const float* const> b, float s, const Weights& to,
            const Weights& back, std::span<float* const> out, CarrySide side, int index) const;
};

namespace {

// Whether points of a block may come over a tile and the pixels around it at any instant.
bool comes_over(const Tile& block, const Reach& reach, const Tile& tile) {
  if (!reach.any) return false;
  // |D| of the parabola is at most that of its ends and its top, below 1 of `mid` and 1/8 of `end` beyond them.
  const auto least = [](float mid, float end) {
    return std::min(0.0f, mid) + std::min(0.0f, end) - 0.125f * std::max(0.0f, end);
  };
  const auto most = [](float mid, float end) {
    return std::max(0.0f, mid) + std::max(0.0f, end) - 0.125f * std::min(0.0f, end);
  };
  const auto overlap = [](int a0, int a1, float low, float high, int b0, int b1) {
    return static_cast<float>(a0) + low < static_cast<float>(b1) + 4 &&
           static_cast<float>(a1) + high > static_cast<float>(b0) - 4;
  };
  return overlap(block.x0, block.x1, least(reach.mid_least.x, reach.end_least.x),
                 most(reach.mid_most.x, reach.end_most.x), tile.x0, tile.x1) &&
         overlap(block.y0, block.y1, least(reach.mid_least.y, reach.end_least.y),
                 most(reach.mid_most.y, reach.end_most.y), tile.y0, tile.y1);
}

std::array<std::vector<float>, kMotionChannels> from_flow(std::span<const float> flow, std::size_t channels,
                                                          std::size_t pixels) {
  std::array<std::vector<float>, kMotionChannels> out;
  for (std::size_t c = 0; c < kMotionChannels; ++c) out[c].assign(pixels, kNaN);
  for (std::size_t side = 0; side < channels / 2; ++side)
    for (std::size_t i = 0; i < pixels; ++i) {
      const float x = flow[2 * side * pixels + i], y = flow[(2 * side + 1) * pixels + i];
      const float z = 1 / (1 + std::hypot(x, y));
      const float values[6] = {0.5f * x, 0.5f * y, x, y, z, z};
      for (std::size_t c = 0; c < 6; ++c) out[6 * side + c][i] = values[c];
    }
  return out;
}

}  // namespace

void Carrier::Interval::find_near() {
  const int tiles = first.tiles_x() * first.tiles_y();
  near.resize(static_cast<std::size_t>(tiles));
  tbb::parallel_for(0, tiles, [&](int i) {
    Near& n = near[static_cast<std::size_t>(i)];
    const Tile here = first.tile(i);
    for (int k = 0; k < tiles; ++k) {
      if (comes_over(first.tile(k), first.reach(k), here)) {
        n.first.push_back(k);
        n.still &= !first.reach(k).moves;
      }
      if (comes_over(second.tile(k), second.reach(k), here)) {
        n.second.push_back(k);
        n.still &= !second.reach(k).moves;
      }
    }
    n.still &= !first.reach(i).unknown && !second.reach(i).unknown;
  });
}

void Carrier::Interval::tile(std::span<const float* const> a, std::span<const float* const> b, float s,
                             const Weights& to, const Weights& back, std::span<float* const> out, CarrySide side,
                             int index) const {
  const Near& n = near[static_cast<std::size_t>(index)];
  const Tile t = first.tile(index);
  const auto width = static_cast<std::size_t>(first.width());
  const auto rows = [&](const auto& pixel) {
    for (int y = t.y0; y < t.y1; ++y)
      for (int x = t.x0; x < t.x1; ++x) pixel(x, y, static_cast<std::size_t>(y) * width + static_cast<std::size_t>(x));
  };
  if (n.still) {
    for (std::size_t k = 0; k < out.size(); ++k)
      rows([&](int, int, std::size_t i) {
        out[k][i] = side == CarrySide::both    ? between(a[k][i], b[k][i], s)
                    : side == CarrySide::first ? a[k][i]
                                               : b[k][i];
      });
    return;
  }
  Seen seen[2][kTileWidth * kTileHeight];
  Landing landing;
  const auto look = [&](const Surfaces& from, const Weights& w, std::span<const std::int32_t> tiles, Seen* found) {
    landing.land(from, w, t, tiles);
    rows([&](int x, int y, std::size_t) { found[(y - t.y0) * kTileWidth + x - t.x0] = find(from, w, landing, x, y); });
  };
  if (side != CarrySide::second) look(first, to, n.first, seen[0]);
  if (side != CarrySide::first) look(second, back, n.second, seen[1]);
  for (std::size_t k = 0; k < out.size(); ++k)
    rows([&](int x, int y, std::size_t i) {
      const auto at = static_cast<std::size_t>((y - t.y0) * kTileWidth + x - t.x0);
      const Light la = light_of(first, a[k], seen[0][at]), lb = light_of(second, b[k], seen[1][at]);
      if (side == CarrySide::both)
        out[k][i] = blend(seen[0][at], la, seen[1][at], lb, a[k][i], b[k][i], s);
      else
        out[k][i] = la.soiled || lb.soiled ? kNaN : side == CarrySide::first ? la.value : lb.value;
    });
}

Carrier::Carrier(std::span<const float> values, int width, int height) {
  const std::size_t pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  const std::size_t channels = pixels ? values.size() / pixels : 0;
  if (width < 1 || height < 1 || channels * pixels != values.size() ||
      (channels != 2 && channels != 4 && channels != kMotionChannels))
    throw bad_input("motion", "size", fmt::format("{} values for {}x{} pixels", values.size(), width, height),
                    "2, 4 or 12 channels");
  std::array<std::vector<float>, kMotionChannels> flow;
  const float* planes[kMotionChannels];
  if (channels != kMotionChannels) flow = from_flow(values, channels, pixels);
  for (std::size_t c = 0; c < kMotionChannels; ++c)
    planes[c] = channels == kMotionChannels ? values.data() + c * pixels : flow[c].data();
  const auto side = [&](std::size_t c) {
    return Surfaces({planes[c], planes[c + 1], planes[c + 2], planes[c + 3], planes[c + 4], planes[c + 5]}, width,
                    height);
  };
  interval_ = std::make_unique<Interval>(Interval{side(0), side(6)});
  interval_->find_near();
}

Carrier::~Carrier() = default;
Carrier::Carrier(Carrier&&) noexcept = default;
Carrier& Carrier::operator=(Carrier&&) noexcept = default;

double Carrier::longest_path_px() const {
  return std::max(interval_->first.longest_path_px(), interval_->second.longest_path_px());
}

std::vector<double> Carrier::instants(double length_us, int subpixels) const {
  constexpr double kStep_px = 0.5;
  const double parts = std::min(std::max(1.0, length_us), std::ceil(longest_path_px() / (kStep_px * subpixels)));
  std::vector<double> fractions;
  for (double k = 1; k < parts; ++k) fractions.push_back(k / parts);
  return fractions;
}

void Carrier::planes(std::span<const float* const> first, std::span<const float* const> second, double s,
                     std::span<float* const> out, CarrySide side) const {
  const std::size_t pixels =
      static_cast<std::size_t>(interval_->first.width()) * static_cast<std::size_t>(interval_->first.height());
  if ((s <= 0 && side != CarrySide::second) || (s >= 1 && side != CarrySide::first)) {
    for (std::size_t k = 0; k < out.size(); ++k) std::copy_n(s <= 0 ? first[k] : second[k], pixels, out[k]);
    return;
  }
  const Weights to(s), back(1 - s);
  tbb::parallel_for(0, static_cast<int>(interval_->near.size()),
                    [&](int i) { interval_->tile(first, second, static_cast<float>(s), to, back, out, side, i); });
}

}  // namespace pecs::sensor
