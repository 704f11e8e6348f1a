#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "motion/kernel.h"
#include "motion/keyframe_interval.h"
#include "motion/sampling.h"
#include "motion/view.h"
#include "pecs/error.h"
#include "pecs/sensor/motion.h"

namespace pecs::sensor {

using namespace motion;

namespace {

// Planes of both keyframes; without spline coefficients if nothing moves.
struct CarryJob {
  std::span<const float* const> first, second;
  CarrySide side;
  std::vector<SplinePlane> spline_planes[2];
};

// Warps one tile of the picture, instant by instant.
class TileWork {
 public:
  TileWork(const CarryJob& job, const Tile& tile, int width)
      : job_(job), tile_(tile), width_(static_cast<std::size_t>(width)) {}

  // A tile that nothing moves over. out: one plane per plane of the keyframes.
  void still(float s, std::span<float* const> out) {
    for (std::size_t k = 0; k < out.size(); ++k) {
      load(job_.first[k], light_[0]);
      load(job_.second[k], light_[1]);
      const bool both = job_.side == CarrySide::both;
      if (both) blend_run(light_[0], light_[1], s, kTilePixels, out_);
      store(both ? out_ : light_[job_.side == CarrySide::first ? 0 : 1], out[k]);
    }
  }

  void carried(View* first, View* second, bool special, float s, std::span<float* const> out) {
    View* const views[2] = {first, second};
    std::vector<BoundaryPixel> boundaries;
    if (special) boundaries = boundaries_of(tile_, first, second);
    if (first && second) drop_hidden(first->landing.points, second->landing.points);
    for (std::size_t k = 0; k < out.size(); ++k) {
      const float* const planes[2] = {job_.first[k], job_.second[k]};
      for (int v = 0; v < 2; ++v)
        if (views[v]) sample(*views[v], job_.spline_planes[v][k], special, light_[v], mixed_[v]);
      if (first && second) {
        if (special) prefer_clean();
        blend_run(light_[0], light_[1], s, kTilePixels, out_);
        fill_unseen(planes, s);
      } else {
        take_alone(first ? 0 : 1, special);
      }
      for (const BoundaryPixel& boundary : boundaries) add_boundary(boundary, views, k, s);
      store(out_, out[k]);
    }
  }

 private:
  std::size_t rows() const { return static_cast<std::size_t>(tile_.y1 - tile_.y0); }
  std::size_t columns() const { return static_cast<std::size_t>(tile_.x1 - tile_.x0); }
  std::size_t pixel(std::size_t row) const {
    return (static_cast<std::size_t>(tile_.y0) + row) * width_ + static_cast<std::size_t>(tile_.x0);
  }
  void load(const float* plane, float* light) const {
    for (std::size_t row = 0; row < rows(); ++row) std::copy_n(plane + pixel(row), columns(), light + row * kTileWidth);
  }
  void store(const float* light, float* plane) const {
    for (std::size_t row = 0; row < rows(); ++row) std::copy_n(light + row * kTileWidth, columns(), plane + pixel(row));
  }

  void sample(const View& view, const SplinePlane& spline, bool special, float* light, bool* mixed) const {
    const Landing::Layer& points = view.landing.points;
    const Surfaces& from = view.from;
    for (std::size_t row = 0; row < rows(); ++row) {
      const std::size_t slot = Landing::slot(0, static_cast<int>(row));
      float* out = light + row * kTileWidth;
      if (from.width() > 3 && from.height() > 3)
        cubic_run(spline.plane(), spline.coefficients(), from.width(), from.height(), points.u + slot, points.v + slot,
                  kTileWidth, out);
      for (std::size_t i = 0; i < columns(); ++i) out[i] = points.index[slot + i] == kNone ? kDark : out[i];
      if (!special) continue;
      for (std::size_t i = 0; i < columns(); ++i) {
        const VisiblePoint seen = points.seen(slot + i);
        mixed[row * kTileWidth + i] = false;
        if (!seen.is()) continue;
        if (from.flags(seen.index) & kNearMixed) {
          const SampledLight own = own_light(from, spline.plane(), seen);
          out[i] = own.value;
          mixed[row * kTileWidth + i] = own.mixed;
        } else if (!(seen.u >= 1 && seen.v >= 1 && seen.u < static_cast<float>(from.width() - 2) &&
                     seen.v < static_cast<float>(from.height() - 2))) {
          out[i] = spline.at(seen.u, seen.v);
        }
      }
    }
  }

  void prefer_clean() {
    for (std::size_t i = 0; i < kTilePixels; ++i)
      if (mixed_[0][i] != mixed_[1][i] && std::isfinite(light_[0][i]) && std::isfinite(light_[1][i]))
        light_[mixed_[0][i] ? 0 : 1][i] = kDark;
  }

  // Pixels that neither keyframe shows are blended in place.
  void fill_unseen(const float* const (&planes)[2], float s) {
    for (std::size_t row = 0; row < rows(); ++row)
      for (std::size_t i = 0; i < columns(); ++i) {
        float& out = out_[row * kTileWidth + i];
        if (!std::isfinite(out)) out = blend(planes[0][pixel(row) + i], planes[1][pixel(row) + i], s);
      }
  }

  void take_alone(int side, bool special) {
    for (std::size_t i = 0; i < kTilePixels; ++i) out_[i] = special && mixed_[side][i] ? kDark : light_[side][i];
  }

  void add_boundary(const BoundaryPixel& boundary, View* const (&views)[2], std::size_t k, float s) {
    float& out = out_[static_cast<std::size_t>(boundary.row * kTileWidth + boundary.column)];
    float light[2] = {kDark, kDark};
    for (int v = 0; v < 2; ++v)
      if (boundary.seen[v].is())
        light[v] = boundary_light(views[v]->from, job_.spline_planes[v][k], boundary.seen[v], out);
    const float found = blend(light[0], light[1], s);
    if (std::isfinite(found)) out = found;
  }

  const CarryJob& job_;
  const Tile& tile_;
  std::size_t width_;
  float light_[2][kTilePixels + kSpare] = {}, out_[kTilePixels + kSpare] = {};
  bool mixed_[2][kTilePixels] = {};
};

// Tiles [x0, x1) x [y0, y1), counted in tiles, that a block's points and their neighbours may reach at any instant.
Tile tiles_reached(const Surfaces& from, const Tile& block, const Reach& reach) {
  Vec2 least, most;
  constexpr int kParts = 32;  // between these instants, a path strays by less than the margin
  for (int i = 1; i <= kParts; ++i) {
    const Weights w(static_cast<double>(i) / kParts);
    const Vec2 low = reach.least(w), high = reach.most(w);
    least = {std::min(least.x, low.x), std::min(least.y, low.y)};
    most = {std::max(most.x, high.x), std::max(most.y, high.y)};
  }
  constexpr float kMargin_px = 4;
  const auto reached = [](float low, float high, int tile_size, int size, int tiles) {
    const auto is_reached = [&](int i) {
      return low < static_cast<float>(std::min((i + 1) * tile_size, size)) + kMargin_px &&
             high > static_cast<float>(i * tile_size) - kMargin_px;
    };
    int begin = 0;
    while (begin < tiles && !is_reached(begin)) ++begin;
    int end = begin;
    while (end < tiles && is_reached(end)) ++end;
    return std::pair(begin, end);
  };
  const auto [x0, x1] = reached(static_cast<float>(block.x0) + least.x, static_cast<float>(block.x1) + most.x,
                                kTileWidth, from.width(), from.tiles_x());
  const auto [y0, y1] = reached(static_cast<float>(block.y0) + least.y, static_cast<float>(block.y1) + most.y,
                                kTileHeight, from.height(), from.tiles_y());
  return {x0, y0, x1, y1};
}

// The layer's channels from optical flow; unknown values are NaN.
std::vector<float> from_flow(std::span<const float> flow, std::size_t channels, std::size_t pixels) {
  std::vector<float> out(kMotionChannels * pixels, kDark);
  for (std::size_t side = 0; side < channels / 2; ++side)
    for (std::size_t i = 0; i < pixels; ++i) {
      const float x = flow[2 * side * pixels + i], y = flow[(2 * side + 1) * pixels + i];
      const float z = 1 / (1 + std::hypot(x, y));
      float* to = out.data() + kPathChannels * side * pixels + i;
      for (std::size_t q = 0; q < kQuarters; ++q) {
        const float part = static_cast<float>(q + 1) / kQuarters;
        to[2 * q * pixels] = part * x, to[(2 * q + 1) * pixels] = part * y;
      }
      for (std::size_t c = kPathChannels - 2; c < kPathChannels; ++c) to[c * pixels] = z;
    }
  return out;
}

}  // namespace

// Lists each block at the tiles that it reaches: the work is linear in the number of tiles, unless everything moves
// far.
void Carrier::KeyframeInterval::find_near() {
  const int columns = first.tiles_x(), tiles = columns * first.tiles_y();
  near.resize(static_cast<std::size_t>(tiles));
  for (int k = 0; k < tiles; ++k) {
    const Tile block = first.tile(k);
    const bool border = block.x0 == 0 || block.y0 == 0 || block.x1 == first.width() || block.y1 == first.height();
    const auto add = [&](const Surfaces& from, std::vector<std::int32_t> Near::* list) {
      const Reach& reach = from.reach(k);
      if (!reach.any) return;
      const Tile reached = tiles_reached(from, block, reach);
      for (int y = reached.y0; y < reached.y1; ++y)
        for (int x = reached.x0; x < reached.x1; ++x) {
          Near& n = near[static_cast<std::size_t>(y * columns + x)];
          (n.*list).push_back(k);
          n.still &= !reach.moves;
          n.special |= reach.mixed || border;
        }
    };
    add(first, &Near::first);
    add(second, &Near::second);
  }
  for (int i = 0; i < tiles; ++i)
    near[static_cast<std::size_t>(i)].still &= !first.reach(i).unknown && !second.reach(i).unknown;
}

void check_motion_size(std::size_t values, int width, int height) {
  const std::size_t pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  const std::size_t channels = pixels ? values / pixels : 0;
  if (width < 1 || height < 1 || channels * pixels != values ||
      (channels != 2 && channels != 4 && channels != kMotionChannels))
    throw bad_input("motion", "size", fmt::format("{} values for {}x{} pixels", values, width, height),
                    fmt::format("2, 4 or {} channels", kMotionChannels));
}

Carrier::Carrier(std::span<const float> values, int width, int height) {
  check_motion_size(values.size(), width, height);
  const std::size_t pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  const std::size_t channels = values.size() / pixels;
  std::vector<float> flow;
  if (channels != kMotionChannels) values = flow = from_flow(values, channels, pixels);
  interval_ = std::make_unique<KeyframeInterval>(width, height);
  interval_->put(0, height, values.data());
  interval_->close();
}

Carrier::Carrier(const FrameSource& source, std::int64_t frame)
    : interval_(std::make_unique<KeyframeInterval>(source.info().file_width(), source.info().file_height())) {
  source.read_motion(frame,
                     [&](int y, int rows, std::span<const float> values) { interval_->put(y, rows, values.data()); });
  interval_->close();
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

void Carrier::planes(std::span<const float* const> first, std::span<const float* const> second,
                     std::span<const double> fractions, std::span<float* const> out, CarrySide side,
                     Region rows) const {
  const KeyframeInterval& in = *interval_;
  const std::size_t count = first.size();
  const auto is_keyframe = [&](double s) {
    return (s <= 0 && side != CarrySide::second) || (s >= 1 && side != CarrySide::first);
  };
  for (std::size_t k = 0; k < out.size(); ++k)
    if (const double s = fractions[k / count]; is_keyframe(s))
      std::copy_n((s <= 0 ? first : second)[k % count],
                  static_cast<std::size_t>(in.first.width()) * static_cast<std::size_t>(in.first.height()), out[k]);
  CarryJob job{first, second, side, {}};
  if (!std::ranges::all_of(in.near, &KeyframeInterval::Near::still) && !std::ranges::all_of(fractions, is_keyframe))
    for (std::size_t k = 0; k < count; ++k) {
      job.spline_planes[0].emplace_back(first[k], in.first.width(), in.first.height());
      job.spline_planes[1].emplace_back(second[k], in.first.width(), in.first.height());
    }
  tbb::parallel_for(std::size_t{0}, in.near.size(), [&](std::size_t i) {
    const KeyframeInterval::Near& near = in.near[i];
    const Tile tile = in.first.tile(static_cast<int>(i));
    if (tile.y1 <= rows.begin || tile.y0 >= rows.end) return;
    TileWork work(job, tile, in.first.width());
    View a(in.first), b(in.second);
    for (std::size_t f = 0; f < fractions.size(); ++f) {
      const double s = fractions[f];
      if (is_keyframe(s)) continue;
      const auto to = out.subspan(f * count, count);
      if (near.still) {
        work.still(static_cast<float>(s), to);
        continue;
      }
      if (side != CarrySide::second) a.look(Weights(s), tile, near.first);
      if (side != CarrySide::first) b.look(Weights(1 - s), tile, near.second);
      work.carried(side == CarrySide::second ? nullptr : &a, side == CarrySide::first ? nullptr : &b, near.special,
                   static_cast<float>(s), to);
    }
  });
}

}  // namespace pecs::sensor
