#include "pecs/sensor/sensor.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>

#include "light/moving_light.h"
#include "pecs/error.h"
#include "sense/chip_frames.h"

namespace pecs::sensor {
namespace {

constexpr std::uint32_t kMostTile = 8192;  // pixels
constexpr std::size_t kTilesPerThread = 16, kPartsPerThread = 4;

// work(tile, events) for the tiles of a region in parallel; consecutive tiles share a part of the sorter.
template <class Work>
void for_tiles(PixelRange region, EventSorter& sorter, const Work& work) {
  constexpr std::uint32_t kBlock = PixelModel::kBlock;
  const auto threads = static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
  const auto wanted = static_cast<std::uint32_t>(region.size() / (kTilesPerThread * threads));
  const std::uint32_t tile = std::clamp(wanted / kBlock * kBlock, kBlock, kMostTile);
  const std::size_t first = region.first / tile, tiles = (region.end + tile - 1) / tile - first;
  const std::size_t parts = std::min(tiles, kPartsPerThread * threads);
  sorter.part(parts - 1);
  tbb::parallel_for(std::size_t{0}, parts, [&](std::size_t part) {
    for (std::size_t i = first + part * tiles / parts; i < first + (part + 1) * tiles / parts; ++i) {
      const auto begin = static_cast<std::uint32_t>(i) * tile;
      work({std::max(region.first, begin), std::min(region.end, begin + tile)}, sorter.part(part));
    }
  });
}

// One frame of a batch.
FrameBatch frame_of(const FrameBatch& batch, std::size_t index) {
  const std::size_t at = batch.t_us.size() - batch.planes.size() + index;
  const auto first = batch.t_us.begin() + static_cast<std::ptrdiff_t>(at - std::min<std::size_t>(2, at));
  return {batch.first_frame + static_cast<std::int64_t>(index),
          {batch.planes[index]},
          {first, batch.t_us.begin() + static_cast<std::ptrdiff_t>(at + 1)},
          batch.last && index + 1 == batch.planes.size(),
          batch.exposures};
}

}  // namespace

void FrameClock::check(std::span<const double> t_us) const {
  std::optional<double> before;
  if (!recent_t_us_.empty()) before = recent_t_us_.back();
  for (std::size_t i = 0; i < t_us.size(); before = t_us[i++]) {
    const bool gap = before && t_us[i] > *before + kMostInterval_us;
    if (gap || (before && !(t_us[i] > *before)) || !(t_us[i] >= 0) || t_us[i] > kMostTime_us)
      throw bad_input("frames", fmt::format("time of frame {}", frames_ + static_cast<std::int64_t>(i)),
                      fmt::format("{} us", t_us[i]),
                      gap      ? fmt::format("at most {} us after the frame before", kMostInterval_us)
                      : before ? fmt::format("more than {}", *before)
                               : fmt::format("0 to {}", kMostTime_us));
  }
}

FrameBatch FrameClock::batch(std::span<const float* const> planes, std::span<const double> t_us, bool last) {
  check(t_us);
  if (frames_ == 0 && !t_us.empty()) begin_us_ = t_us.front();
  FrameBatch batch{frames_, {planes.begin(), planes.end()}, recent_t_us_, last};
  batch.t_us.insert(batch.t_us.end(), t_us.begin(), t_us.end());
  frames_ += std::ssize(planes);
  // Later intervals' events are rounded to the end of these intervals at the earliest.
  const std::size_t known = batch.t_us.size();
  recent_t_us_.assign(batch.t_us.end() - static_cast<std::ptrdiff_t>(std::min<std::size_t>(2, known)),
                      batch.t_us.end());
  final_us_ = last ? key_time_us(~EventKey{0}) : known >= 2 ? std::llround(recent_t_us_.front()) : 0;
  return batch;
}

PixelArray::PixelArray(const ModelChoice& choice, const Chip& chip, int width, int height, std::uint64_t seed,
                       double unit_fa, bool causes)
    : model_(open_model(choice, chip, width, height, seed, unit_fa, causes)), traits_(model_traits(choice)) {}

void PixelArray::advance(const FrameBatch& batch, PixelRange region, EventSorter& sorter) {
  const auto advance = [&](const FrameBatch& frames) {
    if (!traits_.in_tiles) return model_->advance(frames, region, sorter.part(0));
    for_tiles(region, sorter, [&](PixelRange tile, EventSlots& events) { model_->advance(frames, tile, events); });
  };
  if (traits_.pixels_are_independent) return advance(batch);
  for (std::size_t i = 0; i < batch.planes.size(); ++i) {
    const FrameBatch frame = frame_of(batch, i);
    for_tiles(region, sorter, [&](PixelRange tile, EventSlots&) { model_->survey(frame, tile); });
    advance(frame);
  }
}

Sensor::Sensor(const Chip& chip, int width, int height, std::uint64_t seed, double unit_fa, const ModelChoice& model,
               const SensorExtras& extras)
    : width_(width),
      height_(height),
      pixels_(model, chip, width, height, seed, unit_fa, extras.causes),
      sorter_(width, extras.causes),
      stages_(extras.stages, width, height),
      has_stages_(extras.stages.any()) {
  if (extras.readout && !is_ideal_readout(chip)) readout_.emplace(chip, width, height, seed);
  if (chip.takes_frames)
    frames_ =
        std::make_unique<ChipFrames>(chip, width, height, unit_fa, extras.noise ? std::optional(seed) : std::nullopt);
}

Sensor::~Sensor() = default;

std::vector<events::Frame> Sensor::take_frames() {
  if (!frames_) return {};
  std::vector<events::Frame> out = frames_->take();
  const std::int64_t begin_us = std::llround(clock_.begin_us());
  for (events::Frame& frame : out) frame.begin_us += begin_us, frame.end_us += begin_us;
  return out;
}

void Sensor::push(std::span<const float* const> planes, std::span<const double> t_us, bool last, LabelledEvents& out) {
  advance(planes, t_us, last, out);
  if (planes.empty()) return;
  last_plane_.assign(planes.back(), planes.back() + pixels());
  last_t_us_ = t_us.back();
}

void Sensor::push_moving(std::span<const float* const> planes, std::span<const double> t_us, const float* motion,
                         std::size_t channels, bool last, LabelledEvents& events) {
  // Before anything is simulated: an error in a later frame must not cost events of the frames before it.
  clock_.check(t_us);
  if (!planes.empty()) check_motion_size(channels * pixels(), width_, height_);
  MovingLight moving(width_, height_);
  for (std::size_t i = 0; i < planes.size(); ++i, motion += channels * pixels()) {
    if (!last_plane_.empty()) {
      LightInterval interval{.first = {last_plane_.data()},
                             .second = {planes[i]},
                             .carrier = Carrier({motion, channels * pixels()}, width_, height_)};
      interval.carried.emplace(*interval.carrier, interval.first, interval.second);
      const double length_us = t_us[i] - last_t_us_;
      const std::vector<double> moves =
          interval.carrier->instants(length_us, Carrier::kStep_px, std::llround(last_t_us_));
      interval.instants.insert(interval.instants.end(), moves.begin(), moves.end());
      moving.along(interval, [&](std::size_t first, std::span<const float* const> between) {
        if (first == 0) between = between.subspan(1);  // pushed before
        std::vector<double> between_us;
        for (std::size_t k = 0; k < between.size(); ++k)
          between_us.push_back(last_t_us_ + length_us * interval.instants[std::max<std::size_t>(first, 1) + k]);
        advance(between, between_us, false, events);
        return true;
      });
    }
    push({&planes[i], 1}, {&t_us[i], 1}, last && i + 1 == planes.size(), events);
  }
  if (planes.empty()) push({}, {}, last, events);
}

void Sensor::advance(std::span<const float* const> planes, std::span<const double> t_us, bool last,
                     LabelledEvents& out) {
  FrameBatch batch = clock_.batch(planes, t_us, last);
  if (frames_) {
    const double begin_us = clock_.begin_us();
    std::vector<double> since_begin_us(t_us.begin(), t_us.end());
    for (double& t : since_begin_us) t -= begin_us;
    frames_->add(planes, since_begin_us, {0, height_});
    if (!batch.t_us.empty())
      batch.exposures = frames_->exposures(batch.t_us.front() - begin_us, batch.t_us.back() - begin_us);
    for (ChipExposure& exposure : batch.exposures) exposure.begin_us += begin_us, exposure.end_us += begin_us;
  }
  sorter_.begin(batch.t_us);
  pixels_.advance(batch, {0, static_cast<std::uint32_t>(pixels())}, sorter_);
  if (!readout_ && !has_stages_) return sorter_.take(clock_.final_us(), out);
  stages_.begin_at(std::llround(clock_.begin_us()));
  for (LabelledEvents* part : {&fired_, &sent_}) part->events.clear(), part->causes.clear();
  sorter_.take(clock_.final_us(), fired_);
  stages_.before_readout(fired_);
  if (!has_stages_) return readout_->push(fired_, last, out);
  if (readout_)
    readout_->push(fired_, last, sent_);
  else
    std::swap(fired_, sent_);
  stages_.after_readout(sent_, last);
  out.events.insert(out.events.end(), sent_.events.begin(), sent_.events.end());
  out.causes.insert(out.causes.end(), sent_.causes.begin(), sent_.causes.end());
}

}  // namespace pecs::sensor
