#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "motion/keyframe_interval.h"
#include "motion/sampling.h"
#include "pecs/error.h"
#include "pecs/sensor/motion.h"
#include "pecs/sensor/random.h"

namespace pecs::sensor {

using namespace motion;

namespace {

// Tiles [x0, x1) x [y0, y1), counted in tiles, that a block's points and their neighbours may reach at any instant.
Tile tiles_reached(const Surfaces& from, const Tile& block, const Reach& reach) {
  Vec2 least, most;
  constexpr int kBetween = 32;  // between these instants, a path strays by less than the margin
  for (int i = 1; i <= kBetween; ++i) {
    const Weights w(static_cast<double>(i) / kBetween);
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
          Near& n = near[static_cast<std::size_t>(y) * columns + x];
          (n.*list).push_back(k);
          n.still &= !reach.moves;
          n.special |= reach.mixed || border;
          n.path2 = std::max(n.path2, reach.longest2);
        }
    };
    add(first, &Near::first);
    add(second, &Near::second);
  }
  for (int i = 0; i < tiles; ++i)
    if (first.reach(i).unknown || second.reach(i).unknown) {
      Near& n = near[static_cast<std::size_t>(i)];
      n.still = false;
      n.path2 = std::numeric_limits<float>::infinity();
    }
}

std::vector<float> motion_of_flow(std::span<const float> flow, std::size_t channels) {
  const std::size_t pixels = flow.size() / channels;
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
  if (channels != kMotionChannels) values = flow = motion_of_flow(values, channels);
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

std::vector<Carrier::Part> Carrier::parts() const {
  std::vector<Part> out;
  for (std::size_t i = 0; i < interval_->near.size(); ++i) {
    const motion::Tile tile = interval_->first.tile(static_cast<int>(i));
    out.push_back({{tile.x0, tile.y0, tile.x1, tile.y1}, std::sqrt(interval_->near[i].path2)});
  }
  return out;
}

std::vector<double> Carrier::instants(double length_us, double step_px, std::int64_t draw) const {
  constexpr double kVariation = 0.25;
  const double parts = std::ceil(longest_path_px() / step_px);
  if (2 * parts > length_us) {  // as far apart as that allows
    std::vector<double> even;
    const double most = std::min(std::max(1.0, std::floor(length_us)), parts);
    for (double k = 1; k < most; ++k) even.push_back(k / most);
    return even;
  }
  std::vector<double> fractions;
  double sum = 0;
  for (std::uint32_t k = 0; k < parts; ++k) {
    const Random4 random = philox({k, static_cast<std::uint32_t>(draw), static_cast<std::uint32_t>(draw >> 32), 0}, 0);
    sum += 1 + kVariation * (2 * uniform(random[0]) - 1);
    fractions.push_back(sum);
  }
  for (double& fraction : fractions) fraction /= sum;
  if (!fractions.empty()) fractions.pop_back();  // the second keyframe
  return fractions;
}

}  // namespace pecs::sensor
