#include "dense_feed.h"

#include <algorithm>
#include <cmath>

#include "subpixels.h"

namespace pecs::sensor {
DenseFeed::DenseFeed(const Timeline& timeline, PhotocurrentReader& light)
    : timeline_(timeline),
      light_(light),
      pixels_(static_cast<std::size_t>(light.info().width) * static_cast<std::size_t>(light.info().height)) {
  loop_.is_on = timeline.loops();
  is_ahead_ = light.info().subpixels == 1;  // else two intervals hold too much
  soon_.first = read(0);
  load(0, soon_.first, soon_);
}

DenseFeed::Plane DenseFeed::read(std::int64_t step) {
  const auto side = static_cast<std::size_t>(light_.info().subpixels);
  Plane plane(pixels_ * side * side);
  light_.read_fine(timeline_.frame(step), plane.data());
  return plane;
}

// The light at its end, and how it gets there from `first`.
void DenseFeed::load(std::int64_t step, const Plane& first, Interval& interval) {
  interval.carrier.reset();
  interval.residuals = {};
  interval.at = {0.0};
  if (step + 1 >= *timeline_.steps()) return;
  interval.second = read(step + 1);
  const StackInfo& info = light_.info();
  interval.carrier.emplace(info.file_width(), info.file_height(),
                           [&](const RowSink& sink) { timeline_.source().read_motion(timeline_.frame(step), sink); });
  const auto between = interval.carrier->instants(timeline_.t_us(step + 1) - timeline_.t_us(step), info.subpixels);
  interval.at.insert(interval.at.end(), between.begin(), between.end());
  load_between(step, first, interval);
}

// What was rendered within the interval, and planes at its instants in place of those close to them.
void DenseFeed::load_between(std::int64_t step, const Plane& first, Interval& interval) {
  const double close = 0.25 / static_cast<double>(interval.at.size());
  std::vector<double> instants;
  interval.residuals = residuals_of(light_, timeline_.frame(step), timeline_.t_us(step + 1) - timeline_.t_us(step),
                                    *interval.carrier, first.data(), interval.second.data(), instants);
  for (const double s : instants)
    std::erase_if(interval.at, [&](double at) { return at > 0 && std::abs(at - s) < close; });
  interval.at.insert(interval.at.end(), instants.begin(), instants.end());
  std::ranges::sort(interval.at);
}

void DenseFeed::begin_interval() {
  if (step_ > 0 && !is_ahead_) {
    now_.carrier.reset();
    load(step_, now_.second, soon_);
  }
  ahead_.wait();
  std::swap(now_, soon_);
  if (step_ > 0) std::swap(now_.first, soon_.second);  // the end of the one before
  if (is_ahead_ && step_ + 1 < *timeline_.steps())
    ahead_.run([this, step = step_ + 1] { load(step, now_.second, soon_); });
}

double DenseFeed::t_us(double fraction) const {
  const double start = timeline_.t_us(step_);
  return fraction == 0 ? start : start + (timeline_.t_us(step_ + 1) - start) * fraction;
}

std::optional<Feed::Batch> DenseFeed::next() {
  if (step_ == *timeline_.steps()) return {};
  Batch batch = loop_.is_whole ? from_loop() : part();
  batch.last = step_ == *timeline_.steps();
  return batch;
}

// Means of a plane's subpixels.
void DenseFeed::average(const Plane& fine, Plane& plane) const {
  plane.resize(pixels_);
  average_squares(fine, light_.info().file_width(), light_.info().subpixels, plane);
}

// Carried planes of the present interval.
void DenseFeed::carry(std::span<const double> fractions, std::span<Plane> planes) {
  const float *first = now_.first.data(), *second = now_.second.data();
  std::vector<float*> out;
  for (Plane& plane : planes) {
    plane.resize(now_.first.size());
    out.push_back(plane.data());
  }
  now_.carrier->planes({&first, 1}, {&second, 1}, fractions, out);
  for (std::size_t k = 0; k < planes.size(); ++k) now_.residuals.apply(fractions[k], planes[k]);
}

// Of the present interval as many planes as a batch holds.
Feed::Batch DenseFeed::part() {
  if (part_ == 0) begin_interval();
  const bool fine = light_.info().subpixels > 1;
  const std::size_t room = std::max<std::size_t>(1, kBatchBytes / (sizeof(float) * now_.first.size()));
  planes_of_part_.resize(std::max<std::size_t>(1, std::min(now_.at.size() - part_, kBatchBytes / (4 * pixels_))));
  const std::span<Plane> planes = planes_of_part_;
  const std::span fractions = std::span<const double>(now_.at).subspan(part_, planes.size());
  const std::size_t carried = part_ == 0 ? 1 : 0;  // from which on: the first is the keyframe
  if (carried && fine) average(now_.first, planes[0]);
  for (std::size_t k = carried; k < planes.size();) {
    const std::size_t count = std::min(planes.size() - k, room);
    if (!fine) {
      carry(fractions.subspan(k, count), planes.subspan(k, count));
    } else {
      fine_.resize(count);
      carry(fractions.subspan(k, count), fine_);
      for (std::size_t i = 0; i < count; ++i) average(fine_[i], planes[k + i]);
    }
    k += count;
  }
  Batch batch;
  for (std::size_t k = 0; k < planes.size(); ++k) {
    batch.planes.push_back(k < carried && !fine ? now_.first.data() : planes[k].data());
    batch.t_us.push_back(t_us(fractions[k]));
  }
  part_ += planes.size();
  if (loop_.is_on) keep(batch);
  if (part_ == now_.at.size()) {
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
  Loop::Planes& kept = loop_.intervals.back();
  kept.at = now_.at;
  for (const float* plane : batch.planes) kept.planes.emplace_back(plane, plane + pixels_);
}

Feed::Batch DenseFeed::from_loop() {
  const Loop::Planes& kept = loop_.intervals[static_cast<std::size_t>(timeline_.frame(step_))];
  const bool ends = step_ + 1 == *timeline_.steps();
  Batch batch;
  for (std::size_t k = 0; k < (ends ? 1 : kept.planes.size()); ++k) {
    batch.planes.push_back(kept.planes[k].data());
    batch.t_us.push_back(t_us(kept.at[k]));
  }
  ++step_;
  return batch;
}

}  // namespace pecs::sensor
