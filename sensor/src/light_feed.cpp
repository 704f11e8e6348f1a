#include "light_feed.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

namespace pecs::sensor {
namespace {

constexpr std::int64_t kMostOfLoop = 1024;  // steps of a batch

}  // namespace

LightFeed::LightFeed(const Timeline& timeline, PhotocurrentReader& light, Region region)
    : timeline_(timeline),
      light_(light),
      region_(region),
      pixels_(static_cast<std::size_t>(light.info().width) * static_cast<std::size_t>(region.end - region.begin)) {
  if (!timeline.steps()) {  // live
    planes_[0].assign(1, std::vector<float>(pixels_));
    return;
  }
  const std::int64_t frames = timeline.source().frames();
  const std::size_t plane_bytes = pixels_ * sizeof(float);
  is_cached_ = timeline.loops() && plane_bytes * static_cast<std::size_t>(frames) <= kLoopBytes;
  if (is_cached_) {
    batch_ = std::min(frames, kMostOfLoop);
    decode(0, frames, planes_[0]);
  } else {
    const auto threads = static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
    batch_ = static_cast<std::int64_t>(
        std::clamp(kBatchBytes / plane_bytes, std::min<std::size_t>(threads, 16), std::size_t{64}));
    decode(0, end_of_batch(), planes_[0]);
  }
}

void LightFeed::decode(std::int64_t first_step, std::int64_t end_step, Planes& planes) {
  const std::int64_t soon = std::min(*timeline_.steps(), end_step + batch_);
  for (std::int64_t i = end_step; !is_cached_ && i < soon; ++i) timeline_.source().will_read(timeline_.frame(i));
  planes.resize(std::max(planes.size(), static_cast<std::size_t>(end_step - first_step)));
  tbb::parallel_for(first_step, end_step, [&](std::int64_t i) {
    auto& plane = planes[static_cast<std::size_t>(i - first_step)];
    plane.resize(pixels_);
    light_.read(timeline_.frame(i), region_.begin, region_.end, plane.data());
  });
}

std::optional<LightFeed::Batch> LightFeed::next() {
  if (!timeline_.steps()) return next_live();
  if (step_ == *timeline_.steps()) return {};
  ahead_.wait();
  Batch batch;
  const std::int64_t first = step_, end = end_of_batch();
  const std::size_t before = static_cast<std::size_t>(region_.begin) * static_cast<std::size_t>(light_.info().width);
  for (std::int64_t i = first; i < end; ++i) {
    const std::int64_t at = is_cached_ ? timeline_.frame(i) : i - first;
    batch.planes.push_back(planes_[half_][static_cast<std::size_t>(at)].data() - before);
    batch.t_us.push_back(timeline_.t_us(i));
  }
  step_ = end;
  batch.last = step_ == *timeline_.steps();
  if (!is_cached_ && !batch.last) {
    half_ = 1 - half_;
    ahead_.run([this, first_step = step_, end_step = end_of_batch(), &planes = planes_[half_]] {
      decode(first_step, end_step, planes);
    });
  }
  return batch;
}

// A frame as it comes; an empty batch ends it.
std::optional<LightFeed::Batch> LightFeed::next_live() {
  if (ended_) return {};
  const std::optional<double> t_us = timeline_.source().next_us();
  if (t_us && *t_us >= static_cast<double>(timeline_.to_us())) ++beyond_;
  if (!t_us || beyond_ > 2) {  // the last interval of the window needs two frames more
    ended_ = true;
    return Batch{{}, {}, true};
  }
  light_.read(step_++, region_.begin, region_.end, planes_[0][0].data());
  return Batch{{planes_[0][0].data()}, {*t_us}, false};
}

}  // namespace pecs::sensor
