#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <mutex>
#include <vector>

#include "motion/kernel.h"
#include "motion/keyframe_interval.h"
#include "motion/sampling.h"
#include "motion/view.h"
#include "pecs/sensor/motion.h"

namespace pecs::sensor {

using namespace motion;

namespace motion {
struct PreparedLight {
  std::vector<const float*> planes[2]{};  // of either keyframe
  std::once_flag once[2]{};
  std::vector<SplinePlane> splines[2]{};  // empty for a keyframe that was not used
};
}  // namespace motion

namespace {

// Warps one tile of the picture, instant by instant.
class TileWork {
 public:
  TileWork(const PreparedLight& light, const Tile& tile, int width)
      : from_(light), tile_(tile), width_(static_cast<std::size_t>(width)) {}

  // A tile that nothing moves over. out: one plane per plane of the keyframes.
  void still(float s, CarrySide side, std::span<float* const> out) {
    for (std::size_t k = 0; k < out.size(); ++k) {
      load(from_.planes[0][k], light_[0]);
      load(from_.planes[1][k], light_[1]);
      const bool both = side == CarrySide::both;
      if (both) blend_run(light_[0], light_[1], s, kTilePixels, out_);
      store(both ? out_ : light_[side == CarrySide::first ? 0 : 1], out[k]);
    }
  }

  void carried(View* first, View* second, bool special, float s, std::span<float* const> out) {
    View* const views[2] = {first, second};
    std::vector<BoundaryPixel> boundaries;
    if (special) boundaries = boundaries_of(tile_, first, second);
    if (first && second) drop_hidden(first->landing.points, second->landing.points);
    for (std::size_t k = 0; k < out.size(); ++k) {
      const float* const planes[2] = {from_.planes[0][k], from_.planes[1][k]};
      for (int v = 0; v < 2; ++v)
        if (views[v]) sample(*views[v], from_.splines[v][k], special, light_[v], mixed_[v]);
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
      if (from.width() > 3 && from.height() > 3) {
        std::int32_t four[kTileWidth + kSpare];
        cubic_run(spline.cubic(), points.u + slot, points.v + slot, kTileWidth, out, four);
        Edges::Pixel sharp[Edges::kMost];
        std::size_t count = 0;
        for (std::size_t i = 0; i < columns(); ++i)
          if (spline.edges().may_be_at(four[i]) && points.index[slot + i] != kNone)
            sharp[count++] = sharp_pixel(points, slot + i, out + i);
        if (count) spline.edges().sharpen({sharp, count});
      }
      for (std::size_t i = 0; i < columns(); ++i) out[i] = points.index[slot + i] == kNone ? kDark : out[i];
      if (!special) continue;
      for (std::size_t i = 0; i < columns(); ++i) {
        const VisiblePoint seen = points.seen(slot + i);
        mixed[row * kTileWidth + i] = false;
        if (!seen.is()) continue;
        if (from.flags(seen.index) & kNearMixed) {
          const SampledLight own = own_light(from, spline, seen);
          out[i] = own.value;
          mixed[row * kTileWidth + i] = own.mixed;
        } else if (!(seen.u >= 1 && seen.v >= 1 && seen.u < static_cast<float>(from.width() - 2) &&
                     seen.v < static_cast<float>(from.height() - 2))) {
          out[i] = spline.at(seen.u, seen.v);
        }
      }
    }
  }

  // How the picture lies in the keyframe around a pixel.
  static Edges::Pixel sharp_pixel(const Landing::Layer& points, std::size_t slot, float* light) {
    const auto slope = [&](const float* of, std::size_t step) {
      return points.index[slot - step] == kNone || points.index[slot + step] == kNone
                 ? kDark
                 : (of[slot + step] - of[slot - step]) / 2;
    };
    Vec2 by_x{slope(points.u, 1), slope(points.v, 1)},
        by_y{slope(points.u, Landing::kWidth), slope(points.v, Landing::kWidth)};
    constexpr float kMost = 0.7f;  // more is not on one surface
    if (!(std::abs(by_x.x - 1) < kMost && std::abs(by_x.y) < kMost)) by_x = {1, 0};
    if (!(std::abs(by_y.y - 1) < kMost && std::abs(by_y.x) < kMost)) by_y = {0, 1};
    return {points.u[slot], points.v[slot], by_x, by_y, light};
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
      if (boundary.seen[v].is()) light[v] = boundary_light(views[v]->from, from_.splines[v][k], boundary.seen[v], out);
    const float found = blend(light[0], light[1], s);
    if (std::isfinite(found)) out = found;
  }

  const PreparedLight& from_;
  const Tile& tile_;
  std::size_t width_;
  float light_[2][kTilePixels + kSpare] = {}, out_[kTilePixels + kSpare] = {};
  bool mixed_[2][kTilePixels] = {};
};

// The tiles of a picture that meet a box.
std::vector<char> tiles_in(const Surfaces& picture, std::size_t count, std::span<const Box> boxes) {
  std::vector<char> out(count);
  for (std::size_t i = 0; i < count; ++i) {
    const Tile tile = picture.tile(static_cast<int>(i));
    out[i] = std::ranges::any_of(boxes, [&](const Box& box) {
      return tile.x1 > box.x0 && tile.x0 < box.x1 && tile.y1 > box.y0 && tile.y0 < box.y1;
    });
  }
  return out;
}

}  // namespace

CarriedLight::CarriedLight(const Carrier& carrier, std::span<const float* const> first,
                           std::span<const float* const> second)
    : interval_(*carrier.interval_), light_(std::make_unique<PreparedLight>()) {
  light_->planes[0].assign(first.begin(), first.end());
  light_->planes[1].assign(second.begin(), second.end());
}

CarriedLight::~CarriedLight() = default;

void CarriedLight::planes(std::span<const double> fractions, std::span<float* const> out, std::span<const Box> boxes,
                          CarrySide side) const {
  const Carrier::KeyframeInterval& in = interval_;
  PreparedLight& light = *light_;
  const std::size_t count = light.planes[0].size();
  const int width = in.first.width(), height = in.first.height();
  const auto uses = [&](int keyframe) { return side != (keyframe ? CarrySide::first : CarrySide::second); };
  const auto is_keyframe = [&](double s) { return (s <= 0 && uses(0)) || (s >= 1 && uses(1)); };
  for (std::size_t k = 0; k < out.size(); ++k)
    if (const double s = fractions[k / count]; is_keyframe(s))
      std::copy_n(light.planes[s <= 0 ? 0 : 1][k % count],
                  static_cast<std::size_t>(width) * static_cast<std::size_t>(height), out[k]);
  if (std::ranges::all_of(fractions, is_keyframe)) return;
  if (!std::ranges::all_of(in.near, &Carrier::KeyframeInterval::Near::still))
    for (int v = 0; v < 2; ++v)
      if (uses(v))
        std::call_once(light.once[v], [&] {
          tbb::this_task_arena::isolate([&] {  // a task of this thread that waits for the flag would never end
            for (const float* plane : light.planes[v]) light.splines[v].emplace_back(plane, v ? in.second : in.first);
          });
        });
  const std::vector<char> wanted = tiles_in(in.first, in.near.size(), boxes);
  tbb::parallel_for(std::size_t{0}, in.near.size(), [&](std::size_t i) {
    if (!wanted[i]) return;
    const Carrier::KeyframeInterval::Near& near = in.near[i];
    const Tile tile = in.first.tile(static_cast<int>(i));
    TileWork work(light, tile, width);
    View a(in.first), b(in.second);
    for (std::size_t f = 0; f < fractions.size(); ++f) {
      const double s = fractions[f];
      if (is_keyframe(s)) continue;
      const auto to = out.subspan(f * count, count);
      if (near.still) {
        work.still(static_cast<float>(s), side, to);
        continue;
      }
      if (uses(0)) a.look(Weights(s), tile, near.first);
      if (uses(1)) b.look(Weights(1 - s), tile, near.second);
      work.carried(uses(0) ? &a : nullptr, uses(1) ? &b : nullptr, near.special, static_cast<float>(s), to);
    }
  });
}

}  // namespace pecs::sensor
