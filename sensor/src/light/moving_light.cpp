#include "light/moving_light.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>

#include "light/float_math.h"
#include "motion/kernel.h"
#include "stack/light_kernel.h"

namespace pecs::sensor {
namespace {

// How many planes of so many values a batch holds.
std::size_t room_of(std::size_t values) {
  return std::max<std::size_t>(1, MovingLight::kBatchBytes / (sizeof(float) * values));
}

bool is_keyframe(double s) { return s == 0 || s == 1; }

}  // namespace

void Residuals::add(double s, std::span<const float> rendered, std::span<const float> warped) {
  for (std::size_t i = 0; i < rendered.size(); ++i) {
    const float light = std::max(warped[i], kDarkest_fa);
    const float r = log_of(std::max(rendered[i], kDarkest_fa) / light);
    if (std::isfinite(r)) entries_.push_back({static_cast<std::uint32_t>(i), {static_cast<float>(s), r, light}});
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

void Residuals::apply(double s, const float* first, const float* second, float* warped, std::size_t begin,
                      std::size_t end) const {
  const auto now = static_cast<float>(s);
  const auto index_of = [&](std::size_t pixel) {
    return static_cast<std::size_t>(std::ranges::lower_bound(pixels_, pixel) - pixels_.begin());
  };
  tbb::parallel_for(tbb::blocked_range<std::size_t>(index_of(begin), index_of(end), 1 << 13), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      const std::uint32_t pixel = pixels_[i];
      const Residual at_end{1, 0, std::max(second[pixel], kDarkest_fa)};
      Residual before{0, 0, std::max(first[pixel], kDarkest_fa)}, after = at_end;
      for (std::uint32_t k = first_[i]; k < first_[i + 1]; ++k) {
        after = residuals_[k];
        if (after.s >= now) break;
        before = after;
        after = at_end;
      }
      const float part = after.s > before.s ? (now - before.s) / (after.s - before.s) : 1.0f;
      const float light = std::max(warped[pixel], kDarkest_fa), r = before.r + part * (after.r - before.r);
      // An edge that is warped to a wrong place has a large r before it and after it, but not between them.
      const auto [low, high] = std::minmax({before.warped, after.warped});
      const auto [least, most] = std::minmax({before.warped * exp_of(before.r), after.warped * exp_of(after.r)});
      warped[pixel] =
          std::clamp(light * exp_of(r), least * std::min(1.0f, light / low), most * std::max(1.0f, light / high));
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
  const std::size_t room = room_of(pixels_ * lights_);
  const int side = static_cast<int>(side_);
  const Box box{0, rows.begin * side, static_cast<int>(width_) * side, rows.end * side};
  for (std::size_t k = 0; k < fractions.size(); k += room) {
    std::vector<std::size_t> slots(std::min(room, fractions.size() - k));
    std::iota(slots.begin(), slots.end(), std::size_t{0});
    compute(interval, fractions.subspan(k, slots.size()), slots, {&box, 1}, rows);
    if (!give(k, slots.size(), rows, sink)) return false;
  }
  return true;
}

bool MovingLight::along(const LightInterval& interval, const Sink& sink) {
  const Region rows{0, static_cast<int>(pixels_ / width_)};
  const Levels levels = levels_of(interval);
  if (levels.highest == 0) return planes(interval, interval.instants, rows, sink);
  const std::size_t group = std::size_t{1} << levels.highest, all = interval.instants.size();
  const std::size_t room = std::max(group, room_of(pixels_ * lights_) / group * group);
  std::vector<std::vector<Box>> boxes;
  for (std::size_t level = 0; level <= levels.highest; ++level) boxes.push_back(levels.boxes(level));
  for (std::size_t k = 0; k < all; k += room) {
    const std::size_t count = std::min(room, all - k);  // and the instant after them, to interpolate
    std::vector<double> fractions(interval.instants.begin() + static_cast<std::ptrdiff_t>(k),
                                  interval.instants.begin() + static_cast<std::ptrdiff_t>(k + count));
    fractions.push_back(k + count < all ? interval.instants[k + count] : 1);
    for (std::size_t level = 0; level <= levels.highest; ++level) {
      std::vector<std::size_t> slots;
      for (std::size_t slot = k == 0 ? 0 : 1; slot <= count; ++slot) {
        const bool is_whole = slot % group == 0 || slot == count;
        if ((is_whole ? levels.highest : static_cast<std::size_t>(std::countr_zero(slot))) == level)
          slots.push_back(slot);
      }
      compute(interval, fractions, slots, boxes[level], rows);
    }
    interpolate(levels, fractions);
    if (!give(k, count, rows, sink)) return false;
    for (std::size_t i = 0; i < lights_; ++i)  // the next batch begins with it
      std::swap(planes_[i], planes_[count * lights_ + i]);
  }
  return true;
}

bool MovingLight::give(std::size_t first, std::size_t slots, Region rows, const Sink& sink) {
  std::vector<const float*> out;
  for (std::size_t i = 0; i < slots * lights_; ++i) out.push_back(planes_[i].data());
  if (lights_ > mosaics_.size()) pick(rows, out);
  return sink(first, out);
}

MovingLight::Levels MovingLight::levels_of(const LightInterval& interval) const {
  Levels out;
  if (!interval.carrier) return out;
  out.parts = interval.carrier->parts();
  const Box& corner = out.parts[0].box;
  const std::size_t row = width_ * side_,
                    columns = (row + static_cast<std::size_t>(corner.x1) - 1) / static_cast<std::size_t>(corner.x1);
  std::vector<char> corrected(out.parts.size());  // by pictures, which may lie at any instant
  for (const Residuals& residuals : interval.residuals)
    for (const std::uint32_t pixel : residuals.pixels())
      corrected[pixel / row / static_cast<std::size_t>(corner.y1) * columns +
                pixel % row / static_cast<std::size_t>(corner.x1)] = true;
  // By the size of the picture alone: the light of a chip does not depend on others.
  const auto most = static_cast<std::size_t>(std::bit_width(std::min<std::size_t>(room_of(pixels_), 8)) - 1);
  // Planes are farther apart than kStep_px in a short interval, and where motion is estimated.
  const double fastest_px = std::min(interval.carrier->longest_path_px(),
                                     Carrier::kStep_px * static_cast<double>(side_ * interval.instants.size()));
  for (std::size_t i = 0; i < out.parts.size(); ++i) {
    const float path_px = out.parts[i].path_px;
    std::size_t level = 0;
    while (!corrected[i] && path_px > 0 && path_px * static_cast<double>(4 << level) <= fastest_px && level < most)
      ++level;
    out.of_part.push_back(level);
    out.highest = std::max(out.highest, level);
  }
  return out;
}

std::vector<Box> MovingLight::Levels::boxes(std::size_t level) const {
  std::vector<Box> out;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const Box& box = parts[i].box;
    if (of_part[i] > level) continue;
    if (!out.empty() && out.back().x1 == box.x0 && out.back().y0 == box.y0)
      out.back().x1 = box.x1;
    else
      out.push_back(box);
  }
  return out;
}

void MovingLight::interpolate(const Levels& levels, std::span<const double> fractions) {
  const auto side = static_cast<int>(side_);
  const std::size_t last = fractions.size() - 1;
  tbb::parallel_for(std::size_t{0}, levels.parts.size(), [&](std::size_t part) {
    const std::size_t step = std::size_t{1} << levels.of_part[part];
    const Box& fine = levels.parts[part].box;
    const auto left = static_cast<std::size_t>(fine.x0 / side), count = static_cast<std::size_t>(fine.x1 / side) - left;
    for (std::size_t slot = 1; slot < last; ++slot) {
      const std::size_t before = slot / step * step, after = std::min(before + step, last);
      if (before == slot) continue;
      const auto s = static_cast<float>((fractions[slot] - fractions[before]) / (fractions[after] - fractions[before]));
      for (std::size_t i = 0; i < lights_; ++i)
        for (int y = fine.y0 / side; y < fine.y1 / side; ++y) {
          const std::size_t at = static_cast<std::size_t>(y) * width_ + left;
          const float *one = planes_[before * lights_ + i].data() + at,
                      *other = planes_[after * lights_ + i].data() + at;
          float* mean = planes_[slot * lights_ + i].data() + at;
          for (std::size_t x = 0; x < count; ++x) mean[x] = one[x] + s * (other[x] - one[x]);
        }
    }
  });
}

void MovingLight::compute(const LightInterval& interval, std::span<const double> fractions,
                          std::span<const std::size_t> slots, std::span<const Box> boxes, Region rows) {
  const std::size_t fine_pixels = pixels_ * side_ * side_, room = room_of(fine_pixels * lights_);
  for (std::size_t k = 0; k < slots.size(); k += room) {
    std::vector<double> together;
    std::vector<float*> means, fine;
    for (const std::size_t slot : slots.subspan(k, std::min(room, slots.size() - k))) {
      if (planes_.size() < (slot + 1) * lights_) planes_.resize((slot + 1) * lights_, Plane(pixels_ + motion::kSpare));
      together.push_back(fractions[slot]);
      for (std::size_t i = 0; i < lights_; ++i) means.push_back(planes_[slot * lights_ + i].data());
    }
    if (side_ == 1) {
      warp(interval, together, boxes, rows, means);
      continue;
    }
    if (fine_.size() < means.size()) fine_.resize(means.size(), Plane(fine_pixels + motion::kSpare));
    for (std::size_t i = 0; i < means.size(); ++i) fine.push_back(fine_[i].data());
    warp(interval, together, boxes, rows, fine);
    tbb::parallel_for(std::size_t{0}, means.size(), [&](std::size_t i) { average(fine[i], boxes, means[i]); });
  }
}

// out: [fraction][chip][filter], with subpixels.
void MovingLight::warp(const LightInterval& interval, std::span<const double> fractions, std::span<const Box> boxes,
                       Region rows, std::span<float* const> out) const {
  const std::size_t row = width_ * side_ * side_;
  const std::size_t begin = static_cast<std::size_t>(rows.begin) * row, end = static_cast<std::size_t>(rows.end) * row;
  if (!interval.carrier) {
    tbb::parallel_for(std::size_t{0}, out.size(), [&](std::size_t k) {
      const double s = fractions[k / lights_];
      if (is_keyframe(s))
        std::copy_n((s == 0 ? interval.first : interval.second)[k % lights_] + begin, end - begin, out[k] + begin);
      else
        motion::blend_run(interval.first[k % lights_] + begin, interval.second[k % lights_] + begin,
                          static_cast<float>(s), end - begin, out[k] + begin);
    });
    return;
  }
  interval.carried->planes(fractions, out, boxes);
  for (std::size_t k = 0; k < out.size() && !interval.residuals.empty(); ++k)
    if (const double s = fractions[k / lights_]; !is_keyframe(s))
      interval.residuals[k % lights_].apply(s, interval.first[k % lights_], interval.second[k % lights_], out[k], begin,
                                            end);
}

// Means over subpixels, in these boxes of them.
void MovingLight::average(const float* fine, std::span<const Box> boxes, float* mean) const {
  const std::size_t row = width_ * side_;
  for (const Box& box : boxes) {
    const auto left = static_cast<std::size_t>(box.x0) / side_, right = static_cast<std::size_t>(box.x1) / side_;
    for (std::size_t y = static_cast<std::size_t>(box.y0) / side_; y < static_cast<std::size_t>(box.y1) / side_; ++y)
      average_squares(fine + (y * row + left) * side_, row, side_, {mean + y * width_ + left, right - left});
  }
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
