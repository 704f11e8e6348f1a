#include "light/moving_light.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "light/float_math.h"
#include "motion/kernel.h"
#include "stack/light_kernel.h"

namespace pecs::sensor {

void Residuals::add(double s, std::span<const float> rendered, std::span<const float> warped) {
  for (std::size_t i = 0; i < rendered.size(); ++i) {
    const float r = log_of(std::max(rendered[i], kDarkest_fa) / std::max(warped[i], kDarkest_fa));
    if (std::isfinite(r)) entries_.push_back({static_cast<std::uint32_t>(i), {static_cast<float>(s), r}});
  }
}

void Residuals::close() {
  std::ranges::stable_sort(entries_, {}, &Entry::pixel);  // they came by s
  for (const Entry& entry : entries_) {
    if (pixels_.empty() || pixels_.back() != entry.pixel) {
      pixels_.push_back(entry.pixel);
      first_.push_back(static_cast<std::uint32_t>(residuals_.size()));
    }
    residuals_.push_back(entry.residual);
  }
  first_.push_back(static_cast<std::uint32_t>(residuals_.size()));
  entries_ = {};
}

void Residuals::apply(double s, float* warped, std::size_t begin, std::size_t end) const {
  const auto now = static_cast<float>(s);
  const auto index_of = [&](std::size_t pixel) {
    return static_cast<std::size_t>(std::ranges::lower_bound(pixels_, pixel) - pixels_.begin());
  };
  tbb::parallel_for(tbb::blocked_range<std::size_t>(index_of(begin), index_of(end), 1 << 13), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      Residual before{0, 0}, after{1, 0};
      for (std::uint32_t k = first_[i]; k < first_[i + 1]; ++k) {
        after = residuals_[k];
        if (after.s >= now) break;
        before = after;
        after = {1, 0};
      }
      const float part = after.s > before.s ? (now - before.s) / (after.s - before.s) : 1.0f;
      float& light = warped[pixels_[i]];
      light = std::max(light, kDarkest_fa) * exp_of(before.r + part * (after.r - before.r));
    }
  });
}

MovingLight::MovingLight(int width, int height, int subpixels, std::vector<const Mosaic*> mosaics)
    : mosaics_(std::move(mosaics)),
      width_(static_cast<std::size_t>(width)),
      pixels_(width_ * static_cast<std::size_t>(height)),
      side_(static_cast<std::size_t>(subpixels)),
      lights_(0) {
  for (const Mosaic* mosaic : mosaics_) lights_ += mosaic ? mosaic->filters.size() : 1;
}

bool MovingLight::planes(const LightInterval& interval, std::span<const double> fractions, Region rows,
                         const Sink& sink) {
  const std::size_t room = std::max<std::size_t>(1, kBatchBytes / (sizeof(float) * pixels_ * lights_));
  std::vector<const float*> out;
  for (std::size_t k = 0; k < fractions.size(); k += room) {
    out.clear();
    batch(interval, fractions.subspan(k, std::min(room, fractions.size() - k)), rows, out);
    if (lights_ > mosaics_.size()) pick(rows, out);
    if (!sink(k, out)) return false;
  }
  return true;
}

void MovingLight::batch(const LightInterval& interval, std::span<const double> part, Region rows,
                        std::vector<const float*>& out) {
  if (planes_.size() < part.size() * lights_) planes_.resize(part.size() * lights_, Plane(pixels_ + motion::kSpare));
  const std::size_t fine_room =
      side_ > 1 ? std::max<std::size_t>(1, kBatchBytes / (sizeof(float) * pixels_ * side_ * side_ * lights_))
                : part.size();
  for (std::size_t k = 0; k < part.size();) {
    if (part[k] == 0) {  // the keyframe itself
      for (const float* fine : interval.first) {
        Plane& mean = planes_[out.size()];
        if (side_ > 1) average(fine, rows, mean);
        out.push_back(side_ > 1 ? mean.data() : fine);
      }
      ++k;
      continue;
    }
    std::size_t count = 1;
    while (count < fine_room && k + count < part.size() && part[k + count] != 0) ++count;
    const std::span planes = std::span(planes_).subspan(k * lights_, count * lights_);
    if (side_ > 1) {
      if (fine_.size() < planes.size()) fine_.resize(planes.size(), Plane(pixels_ * side_ * side_ + motion::kSpare));
      warp(interval, part.subspan(k, count), rows, std::span(fine_).first(planes.size()));
      for (std::size_t i = 0; i < planes.size(); ++i) average(fine_[i].data(), rows, planes[i]);
    } else {
      warp(interval, part.subspan(k, count), rows, planes);
    }
    for (const Plane& plane : planes) out.push_back(plane.data());
    k += count;
  }
}

// out: [fraction][chip][filter], with subpixels.
void MovingLight::warp(const LightInterval& interval, std::span<const double> fractions, Region rows,
                       std::span<Plane> out) const {
  const std::size_t row = width_ * side_;
  const int side = static_cast<int>(side_);
  const Region fine{rows.begin * side, rows.end * side};
  const std::size_t begin = static_cast<std::size_t>(fine.begin) * row, end = static_cast<std::size_t>(fine.end) * row;
  if (!interval.carrier) {
    tbb::parallel_for(std::size_t{0}, out.size(), [&](std::size_t k) {
      motion::blend_run(interval.first[k % lights_] + begin, interval.second[k % lights_] + begin,
                        static_cast<float>(fractions[k / lights_]), end - begin, out[k].data() + begin);
    });
    return;
  }
  std::vector<float*> to;
  for (Plane& plane : out) to.push_back(plane.data());
  const Box part{.y0 = fine.begin, .y1 = fine.end};
  interval.carried->planes(fractions, to, {&part, 1});
  for (std::size_t k = 0; k < to.size() && !interval.residuals.empty(); ++k)
    interval.residuals[k % lights_].apply(fractions[k / lights_], to[k], begin, end);
}

// Rows of means over subpixels.
void MovingLight::average(const float* fine, Region rows, Plane& mean) const {
  const std::size_t begin = static_cast<std::size_t>(rows.begin) * width_;
  const std::size_t count = static_cast<std::size_t>(rows.end - rows.begin) * width_;
  average_squares({fine + begin * side_ * side_, count * side_ * side_}, static_cast<int>(width_ * side_),
                  static_cast<int>(side_), std::span(mean).subspan(begin, count));
}

void MovingLight::pick(Region rows, std::vector<const float*>& planes) {
  const std::size_t begin = static_cast<std::size_t>(rows.begin) * width_;
  std::vector<const float*> chips;
  for (std::size_t k = 0; k < planes.size();)
    for (const Mosaic* mosaic : mosaics_) {
      if (!mosaic) {
        chips.push_back(planes[k++]);
        continue;
      }
      std::vector<const float*> filters;
      for (std::size_t i = 0; i < mosaic->filters.size(); ++i) filters.push_back(planes[k++] + begin);
      if (picked_.size() <= chips.size()) picked_.resize(chips.size() + 1);
      Plane& plane = picked_[chips.size()];
      plane.resize(pixels_ + motion::kSpare);
      pick_filters(*mosaic, filters, static_cast<int>(width_), rows.begin, rows.end, plane.data() + begin);
      chips.push_back(plane.data());
    }
  planes = std::move(chips);
}

namespace {

// The newest few of what was read.
template <class T>
std::shared_ptr<const T> find(const std::deque<std::shared_ptr<const T>>& kept, std::int64_t frame) {
  const auto found = std::ranges::find(kept, frame, [](const auto& one) { return one->frame; });
  return found == kept.end() ? nullptr : *found;
}

template <class T>
void make_room(std::deque<std::shared_ptr<const T>>& kept, std::size_t most) {
  if (kept.size() == most) kept.pop_front();
}

}  // namespace

IntervalReader::IntervalReader(const std::vector<PhotocurrentReader*>& chips, bool along_motion, std::size_t kept)
    : along_motion_(along_motion), kept_(kept) {
  for (PhotocurrentReader* chip : chips) {
    const std::size_t filters = along_motion ? chip->filters() : 1;
    for (std::size_t filter = 0; filter < filters; ++filter) lights_.push_back({chip, filter});
  }
}

double IntervalReader::t_us(std::int64_t frame) const {
  const StackInfo& info = source().info();
  if (frame == source().frames()) return static_cast<double>(*info.period_ns) * 1e-3;
  return static_cast<double>(info.times_ns[static_cast<std::size_t>(frame)] - info.times_ns[0]) * 1e-3;
}

std::shared_ptr<const Keyframe> IntervalReader::keyframe(std::int64_t frame) {
  if (auto known = find(keyframes_, frame)) return known;
  make_room(keyframes_, 3);
  const StackInfo& info = source().info();
  const int width = along_motion_ ? info.file_width() : info.width;
  const int height = along_motion_ ? info.file_height() : info.height;
  auto read = std::make_shared<Keyframe>(frame, std::vector<Plane>(lights_.size()));
  tbb::parallel_for(std::size_t{0}, lights_.size(), [&](std::size_t k) {
    const Light& light = lights_[k];
    Plane& plane = read->planes[k];
    plane.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height) + motion::kSpare);
    if (along_motion_)
      light.chip->read_fine(frame, light.filter, plane.data());
    else
      light.chip->read(frame, 0, height, plane.data());
  });
  return keyframes_.emplace_back(std::move(read));
}

std::shared_ptr<const LightInterval> IntervalReader::frame(std::int64_t frame) {
  auto alone = std::make_shared<LightInterval>(frame);
  alone->owners[0] = keyframe(frame);
  for (const Plane& plane : alone->owners[0]->planes) alone->first.push_back(plane.data());
  return alone;
}

std::shared_ptr<const LightInterval> IntervalReader::interval(std::int64_t frame) {
  if (auto known = find(intervals_, frame)) return known;
  make_room(intervals_, kept_);
  auto in = std::make_shared<LightInterval>(frame);
  in->owners[0] = keyframe(frame);
  in->owners[1] = keyframe((frame + 1) % source().frames());
  for (const Plane& plane : in->owners[0]->planes) in->first.push_back(plane.data());
  for (const Plane& plane : in->owners[1]->planes) in->second.push_back(plane.data());
  if (along_motion_) add_motion(*in);
  return intervals_.emplace_back(std::move(in));
}

void IntervalReader::add_motion(LightInterval& in) const {
  const StackInfo& info = source().info();
  const double length_us = t_us(in.frame + 1) - t_us(in.frame);
  in.carrier.emplace(source(), in.frame);
  in.carried.emplace(*in.carrier, in.first, in.second);
  const double step_px = source().estimates_motion() ? Carrier::kStepOfEstimate_px : Carrier::kStep_px * info.subpixels;
  const std::vector<double> along = in.carrier->instants(length_us, step_px, std::llround(t_us(in.frame)));
  in.instants.insert(in.instants.end(), along.begin(), along.end());

  const std::vector<std::int64_t> times_ns = source().between_ns(in.frame);
  if (times_ns.empty()) return;
  const auto begin_ns = static_cast<double>(info.times_ns[static_cast<std::size_t>(in.frame)]);
  for (const std::int64_t t_ns : times_ns)
    in.pictures.push_back((static_cast<double>(t_ns) - begin_ns) / (1e3 * length_us));
  const std::size_t values = static_cast<std::size_t>(info.file_width()) * static_cast<std::size_t>(info.file_height());
  std::vector<Plane> warped(lights_.size(), Plane(values + motion::kSpare));
  std::vector<float*> to;
  for (Plane& plane : warped) to.push_back(plane.data());
  Plane rendered(values);
  in.residuals.resize(lights_.size());
  for (std::size_t k = 0; k < in.pictures.size(); ++k) {
    in.carried->planes({&in.pictures[k], 1}, to);
    for (std::size_t i = 0; i < lights_.size(); ++i) {
      lights_[i].chip->read_between(in.frame, k, lights_[i].filter, rendered.data());
      in.residuals[i].add(in.pictures[k], rendered, std::span(warped[i]).first(values));
    }
  }
  for (Residuals& residuals : in.residuals) residuals.close();
  const double close = 0.25 / static_cast<double>(in.instants.size());
  for (const double s : in.pictures)
    std::erase_if(in.instants, [&](double at) { return at > 0 && std::abs(at - s) < close; });
  in.instants.insert(in.instants.end(), in.pictures.begin(), in.pictures.end());
  std::ranges::sort(in.instants);
}

}  // namespace pecs::sensor
