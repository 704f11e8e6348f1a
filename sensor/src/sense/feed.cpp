#include "sense/feed.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>
#include <tbb/task_group.h>

#include <algorithm>
#include <array>
#include <utility>

#include "light/moving_light.h"

namespace pecs::sensor {
namespace {

// Work that is done ahead. wait() rethrows what it throws; the destructor discards it.
class Prefetch {
 public:
  Prefetch() = default;
  Prefetch(const Prefetch&) = delete;
  Prefetch& operator=(const Prefetch&) = delete;
  ~Prefetch() noexcept {
    group_.cancel();
    try {
      group_.wait();
    } catch (...) {
      return;
    }
  }
  template <class Work>
  void run(Work&& work) {
    group_.run(std::forward<Work>(work));
  }
  void wait() { group_.wait(); }

 private:
  tbb::task_group group_;
};

// Planes of the first loop, interval by interval.
struct HeldLoop {
  struct Interval {
    std::vector<double> instants;
    std::vector<Plane> planes;
  };
  std::size_t most_bytes = 0;
  bool is_on = false;
  std::size_t bytes = 0;
  std::vector<Interval> intervals{};

  void keep(std::int64_t step, const std::vector<double>& instants, std::span<const float* const> planes,
            std::size_t pixels) {
    bytes += sizeof(float) * pixels * planes.size();
    if (bytes > most_bytes) {
      *this = {};
      return;
    }
    intervals.resize(static_cast<std::size_t>(step + 1));
    intervals.back().instants = instants;
    for (const float* plane : planes) intervals.back().planes.emplace_back(plane, plane + pixels);
  }
};

}  // namespace

void feed_frames(const Timeline& timeline, PhotocurrentReader& light, Region region, const LightSink& sink) {
  constexpr std::int64_t kMostOfLoop = 1024;  // steps of a batch
  const std::int64_t steps = timeline.steps(), frames = timeline.source().frames();
  const auto width = static_cast<std::size_t>(light.info().width);
  const std::size_t pixels = width * static_cast<std::size_t>(region.end - region.begin);
  const std::size_t plane_bytes = pixels * sizeof(float);
  const bool is_held = timeline.loops() && plane_bytes * static_cast<std::size_t>(frames) <= kLoopBytes;
  const auto threads = static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
  const std::int64_t size =
      is_held ? std::min(frames, kMostOfLoop)
              : static_cast<std::int64_t>(std::clamp(MovingLight::kBatchBytes / plane_bytes,
                                                     std::min<std::size_t>(threads, 16), std::size_t{64}));
  const auto end_of = [&](std::int64_t first) { return std::min(first + size, steps); };
  const auto decode = [&](std::int64_t first, std::int64_t end, std::vector<Plane>& planes) {
    for (std::int64_t i = end; !is_held && i < end_of(end); ++i) timeline.source().will_read(timeline.frame(i));
    planes.resize(std::max(planes.size(), static_cast<std::size_t>(end - first)));
    tbb::parallel_for(first, end, [&](std::int64_t i) {
      Plane& plane = planes[static_cast<std::size_t>(i - first)];
      plane.resize(pixels);
      light.read(timeline.frame(i), region.begin, region.end, plane.data());
    });
  };

  std::array<std::vector<Plane>, 2> planes;  // of this batch and of the next; held: of all frames, in the first
  decode(0, is_held ? frames : end_of(0), planes[0]);
  Prefetch next;
  for (std::int64_t first = 0; first < steps; first = end_of(first)) {
    LightBatch batch{{}, {}, end_of(first), end_of(first) == steps};
    for (std::int64_t i = first; i < batch.steps; ++i) {
      const std::int64_t at = is_held ? timeline.frame(i) : i - first;
      batch.planes.push_back(planes[0][static_cast<std::size_t>(at)].data() -
                             static_cast<std::size_t>(region.begin) * width);
      batch.t_us.push_back(timeline.t_us(i));
    }
    if (!is_held && !batch.last)
      next.run([&decode, &end_of, &planes, end = batch.steps] { decode(end, end_of(end), planes[1]); });
    if (!sink(batch)) return;
    if (!is_held) {
      next.wait();
      std::swap(planes[0], planes[1]);
    }
  }
}

void feed_moving(const Timeline& timeline, PhotocurrentReader& light, PhotocurrentReader* again, const LightSink& sink,
                 std::size_t loop_bytes) {
  const StackInfo& info = light.info();
  const std::int64_t steps = timeline.steps(), frames = timeline.source().frames();
  const std::size_t pixels = static_cast<std::size_t>(info.width) * static_cast<std::size_t>(info.height);
  const auto t_us = [&](std::int64_t step, double fraction) {
    const double start = timeline.t_us(step);
    return fraction == 0 ? start : start + (timeline.t_us(step + 1) - start) * fraction;
  };
  std::vector<PhotocurrentReader*> readers{&light};
  if (again) readers.push_back(again);
  const std::size_t chips = readers.size();
  IntervalReader reader(readers, true, 1);
  MovingLight moving(info.width, info.height, info.subpixels, std::vector(chips, light.mosaic()));
  const auto add_plane = [](LightBatch& batch, std::span<const float* const> of_chips, double t) {
    batch.planes.push_back(of_chips[0]);
    if (of_chips.size() > 1) batch.again.push_back(of_chips[1]);
    batch.t_us.push_back(t);
  };
  HeldLoop loop{.most_bytes = loop_bytes, .is_on = timeline.loops()};
  std::shared_ptr<const LightInterval> now, next;
  const auto read = [&](std::int64_t step) {
    next = step + 1 < steps ? reader.interval(timeline.frame(step)) : reader.frame(timeline.frame(step));
  };
  Prefetch prefetch;
  for (std::int64_t step = 0; step < steps; ++step) {
    const bool is_last = step + 1 == steps;
    if (loop.is_on && step >= frames) {
      const HeldLoop::Interval& held = loop.intervals[static_cast<std::size_t>(timeline.frame(step))];
      LightBatch batch{{}, {}, step + 1, is_last};
      for (std::size_t k = 0; k < (is_last ? 1 : held.instants.size()); ++k) {
        std::vector<const float*> of_chips;
        for (std::size_t c = 0; c < chips; ++c) of_chips.push_back(held.planes[k * chips + c].data());
        add_plane(batch, of_chips, t_us(step, held.instants[k]));
      }
      if (!sink(batch)) return;
      continue;
    }
    prefetch.wait();
    if (!next) {
      now.reset();  // before another one is read
      read(step);
    }
    now = std::exchange(next, nullptr);
    if (info.subpixels == 1 && !is_last && !(loop.is_on && step + 1 == frames))
      prefetch.run([&read, step] { read(step + 1); });
    const auto give = [&](std::size_t first, std::span<const float* const> planes) {
      const std::size_t count = planes.size() / chips;
      const bool ends = first + count == now->instants.size();
      LightBatch batch{{}, {}, step + (ends ? 1 : 0), ends && is_last};
      for (std::size_t k = 0; k < count; ++k)
        add_plane(batch, planes.subspan(k * chips, chips), t_us(step, now->instants[first + k]));
      if (loop.is_on) loop.keep(step, now->instants, planes, pixels);
      return sink(batch);
    };
    if (!moving.along(*now, give)) return;
  }
}

}  // namespace pecs::sensor
