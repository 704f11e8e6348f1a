#include "dense_feed.h"

#include <algorithm>
#include <cmath>

#include "subpixels.h"

namespace pecs::sensor {
namespace {

constexpr double kStep_px = 0.5;  // of motion between planes

}  // namespace

DenseFeed::DenseFeed(const Timeline& timeline, PhotocurrentReader& light)
    : timeline_(timeline),
      light_(light),
      pixels_(static_cast<std::size_t>(light.info().width) * static_cast<std::size_t>(light.info().height)) {
  loop_.is_on = timeline.loops();
  soon_.first = read(0);
  load(0, soon_);
}

DenseFeed::~DenseFeed() noexcept {
  ahead_.cancel();
  try {
    ahead_.wait();
  } catch (...) {  // of an interval that nobody asked for
  }
}

DenseFeed::Plane DenseFeed::read(std::int64_t step) {
  const auto side = static_cast<std::size_t>(light_.info().subpixels);
  Plane plane(pixels_ * side * side);
  light_.read_fine(timeline_.frame(step), plane.data());
  return plane;
}

// All but the light at its start.
void DenseFeed::load(std::int64_t step, Interval& interval) {
  interval.carrier.reset();
  interval.parts = 1;
  if (step + 1 >= *timeline_.steps()) return;
  interval.second = read(step + 1);
  const StackInfo& info = light_.info();
  interval.carrier.emplace(timeline_.source().read_motion(timeline_.frame(step)), info.file_width(),
                           info.file_height());
  const double most = std::max(1.0, timeline_.t_us(step + 1) - timeline_.t_us(step));  // a microsecond apart
  interval.parts = std::max<std::int64_t>(
      1, std::llround(std::min(most, std::ceil(interval.carrier->longest_path_px() / (kStep_px * info.subpixels)))));
}

void DenseFeed::begin_interval() {
  ahead_.wait();
  std::swap(now_, soon_);
  if (step_ > 0) std::swap(now_.first, soon_.second);  // the end of the one before
  if (step_ + 1 < *timeline_.steps()) ahead_.run([this, step = step_ + 1] { load(step, soon_); });
}

double DenseFeed::t_us(std::int64_t part, std::int64_t parts) const {
  const double start = timeline_.t_us(step_);
  return part == 0
             ? start
             : start + (timeline_.t_us(step_ + 1) - start) * static_cast<double>(part) / static_cast<double>(parts);
}

std::optional<Feed::Batch> DenseFeed::next() {
  if (step_ == *timeline_.steps()) return {};
  Batch batch = loop_.is_whole ? from_loop() : part();
  planes_ += std::ssize(batch.planes);
  batch.last = step_ == *timeline_.steps();
  return batch;
}

// Of the present interval; in the room given, or where it lies already.
const float* DenseFeed::plane(std::int64_t part, Plane& room) {
  const StackInfo& info = light_.info();
  const float *first = now_.first.data(), *second = now_.second.data();
  const bool fine = info.subpixels > 1;
  if (part > 0) {
    Plane& carried = fine ? fine_ : room;
    carried.resize(now_.first.size());
    float* out = carried.data();
    now_.carrier->planes({&first, 1}, {&second, 1}, static_cast<double>(part) / static_cast<double>(now_.parts),
                         {&out, 1});
    first = out;
  }
  if (!fine) return first;
  room.resize(pixels_);
  average_squares({first, now_.first.size()}, info.file_width(), info.subpixels, room);
  return room.data();
}

// Of the present interval as many planes as a batch holds.
Feed::Batch DenseFeed::part() {
  if (part_ == 0) begin_interval();
  const auto room = static_cast<std::int64_t>(std::max<std::size_t>(1, kBatchBytes / (sizeof(float) * pixels_)));
  const std::int64_t end = std::min(now_.parts, part_ + room);
  between_.resize(static_cast<std::size_t>(std::max<std::int64_t>(std::ssize(between_), end - part_)));
  Batch batch;
  for (; part_ < end; ++part_) {
    batch.planes.push_back(plane(part_, between_[batch.planes.size()]));
    batch.t_us.push_back(t_us(part_, now_.parts));
  }
  if (loop_.is_on) keep(batch);
  if (part_ == now_.parts) {
    part_ = 0;
    ++step_;
    if (loop_.is_on && step_ == timeline_.source().frames()) loop_.is_whole = true;
  }
  return batch;
}

// While the first loop is computed.
void DenseFeed::keep(const Batch& batch) {
  loop_.intervals.resize(static_cast<std::size_t>(step_ + 1));
  loop_.bytes += sizeof(float) * pixels_ * batch.planes.size();
  if (loop_.bytes > kLoopBytes) {
    loop_ = {};
    return;
  }
  for (const float* plane : batch.planes) loop_.intervals.back().emplace_back(plane, plane + pixels_);
}

Feed::Batch DenseFeed::from_loop() {
  const auto& planes = loop_.intervals[static_cast<std::size_t>(timeline_.frame(step_))];
  const bool ends = step_ + 1 == *timeline_.steps();
  Batch batch;
  for (std::int64_t k = 0; k < (ends ? 1 : std::ssize(planes)); ++k) {
    batch.planes.push_back(planes[static_cast<std::size_t>(k)].data());
    batch.t_us.push_back(t_us(k, std::ssize(planes)));
  }
  ++step_;
  return batch;
}

}  // namespace pecs::sensor
