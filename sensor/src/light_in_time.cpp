#include "pecs/sensor/light_in_time.h"

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <functional>
#include <limits>
#include <optional>

#include "feed.h"
#include "motion/kernel.h"
#include "pecs/error.h"
#include "pecs/sensor/motion.h"
#include "pecs/sensor/photocurrent.h"
#include "pecs/sensor/timeline.h"
#include "residuals.h"
#include "subpixels.h"

namespace pecs::sensor {
namespace {

using Plane = std::vector<float>;

// A frame's light [fA] on each chip, with its subpixels where it is carried along.
struct Keyframe {
  std::int64_t frame = 0;
  std::vector<Plane> planes;
};

// From a frame to the next one.
struct Interval {
  std::int64_t frame = 0;
  std::shared_ptr<const Keyframe> first, second;
  std::optional<Carrier> carrier;    // none without motion
  std::vector<Residuals> residuals;  // of each chip
};

// The newest few of what was read.
template <class T>
class Recent {
 public:
  explicit Recent(std::size_t most) : most_(most) {}
  std::shared_ptr<T> find(std::int64_t frame) const {
    for (const auto& one : kept_)
      if (one->frame == frame) return one;
    return nullptr;
  }
  void drop_oldest() {
    if (kept_.size() == most_) kept_.pop_front();
  }
  void keep(std::shared_ptr<T> one) {
    drop_oldest();
    kept_.push_back(std::move(one));
  }

 private:
  std::size_t most_;
  std::deque<std::shared_ptr<T>> kept_;
};

// A time within the interval that begins at a frame; part 0: the frame itself.
struct Place {
  std::int64_t frame = 0;
  double part = 0;
};

// One sample of an exposure.
struct Cell {
  Place place;
  Region rows;
  double at = 0;  // its begin, in cells from the exposure's begin
};

}  // namespace

struct LightInTime::Work {
  const FrameSource& source;
  std::vector<std::unique_ptr<PhotocurrentReader>> readers;
  bool along_motion;
  Recent<const Keyframe> keyframes{3};
  Recent<Interval> intervals{2};
  std::vector<double> steps_per_us{};  // of each interval, where known: for half a pixel of motion; else NaN
  std::vector<Plane> scratch{};

  const StackInfo& info() const { return source.info(); }
  int side() const { return along_motion ? info().subpixels : 1; }
  std::size_t pixels() const {
    return static_cast<std::size_t>(info().width) * static_cast<std::size_t>(info().height);
  }
  std::size_t side2() const { return static_cast<std::size_t>(side()) * static_cast<std::size_t>(side()); }
  std::size_t fine_pixels() const { return pixels() * side2(); }
  std::int64_t begin_ns(std::int64_t frame) const {
    const auto& times = info().times_ns;
    return frame < source.frames() ? times[static_cast<std::size_t>(frame)] - times[0] : info().period_ns.value_or(0);
  }
  double end_us() const {
    return info().period_ns ? std::numeric_limits<double>::infinity()
                            : static_cast<double>(begin_ns(source.frames() - 1)) * 1e-3;
  }
  Place place(double t_us) const;
  std::shared_ptr<const Keyframe> keyframe(std::int64_t frame);
  Interval& interval(std::int64_t frame);
  void carry(Interval& in, std::span<const double> parts, Region rows, std::span<Plane> out);
  // Light at parts of an interval, chip by chip for each: give(index of the part, chip, plane [fA], of which `rows`
  // are there).
  using Give = std::function<void(std::size_t, std::size_t, std::span<const float>)>;
  void planes(std::int64_t frame, std::span<const double> parts, Region rows, const Give& give);
  std::int64_t steps_of(const Exposure& exposure, double from_us, double to_us);
  std::vector<Cell> cells(const Exposure& exposure, std::int64_t steps, double from_us, double to_us) const;
};

Place LightInTime::Work::place(double t_us) const {
  constexpr double kSame_ns = 0.5;
  double t_ns = t_us * 1e3;
  if (!(t_ns >= -kSame_ns) || t_us > end_us() + 1e-3 * kSame_ns)
    throw bad_input(source.name(), "t_us", fmt::format("{}", t_us),
                    info().period_ns ? "0 or more" : fmt::format("0 to {}", end_us()));
  if (info().period_ns) t_ns = std::fmod(std::max(t_ns, 0.0), static_cast<double>(*info().period_ns));
  std::int64_t frame = 0, after = source.frames();
  while (after - frame > 1) {
    const std::int64_t middle = (frame + after) / 2;
    (static_cast<double>(begin_ns(middle)) <= t_ns + kSame_ns ? frame : after) = middle;
  }
  const double since_ns = t_ns - static_cast<double>(begin_ns(frame));
  const bool is_last = frame + 1 == source.frames();
  if (since_ns <= kSame_ns || (is_last && !info().period_ns)) return {frame, 0};
  const auto length_ns = static_cast<double>(begin_ns(frame + 1) - begin_ns(frame));
  if (length_ns - since_ns <= kSame_ns) return {is_last ? 0 : frame + 1, 0};
  return {frame, since_ns / length_ns};
}

std::shared_ptr<const Keyframe> LightInTime::Work::keyframe(std::int64_t frame) {
  if (auto known = keyframes.find(frame)) return known;
  keyframes.drop_oldest();
  auto read = std::make_shared<Keyframe>(frame, std::vector<Plane>(readers.size()));
  tbb::parallel_for(std::size_t{0}, readers.size(), [&](std::size_t chip) {
    Plane& plane = read->planes[chip];
    plane.resize(fine_pixels() + motion::kSpare);
    if (along_motion)
      readers[chip]->read_fine(frame, plane.data());
    else
      readers[chip]->read(frame, 0, info().height, plane.data());
  });
  keyframes.keep(read);
  return read;
}

Interval& LightInTime::Work::interval(std::int64_t frame) {
  if (auto known = intervals.find(frame)) return *known;
  intervals.drop_oldest();
  auto in = std::make_shared<Interval>();
  in->frame = frame;
  in->first = keyframe(frame);
  in->second = keyframe((frame + 1) % source.frames());
  const double length_us = 1e-3 * static_cast<double>(begin_ns(frame + 1) - begin_ns(frame));
  double steps = 4;  // without motion
  if (along_motion) {
    in->carrier.emplace(info().file_width(), info().file_height(),
                        [&](const RowSink& sink) { source.read_motion(frame, sink); });
    steps = in->carrier->longest_path_px() / (0.5 * side());
    for (std::size_t chip = 0; chip < readers.size(); ++chip) {
      std::vector<double> instants;
      in->residuals.push_back(residuals_of(*readers[chip], frame, length_us, *in->carrier,
                                           in->first->planes[chip].data(), in->second->planes[chip].data(), instants));
    }
  }
  steps_per_us[static_cast<std::size_t>(frame)] = steps / length_us;
  intervals.keep(in);
  return *in;
}

// out: [part][chip], with subpixels; rows of pixels.
void LightInTime::Work::carry(Interval& in, std::span<const double> parts, Region rows, std::span<Plane> out) {
  const auto row = static_cast<std::size_t>(side()) * static_cast<std::size_t>(info().width);
  const Region fine{rows.begin * side(), rows.end * side()};
  if (!in.carrier) {
    tbb::parallel_for(std::size_t{0}, out.size(), [&](std::size_t k) {
      const std::size_t chip = k % readers.size(), first = static_cast<std::size_t>(rows.begin) * row;
      motion::blend_run(in.first->planes[chip].data() + first, in.second->planes[chip].data() + first,
                        static_cast<float>(parts[k / readers.size()]),
                        static_cast<std::size_t>(rows.end - rows.begin) * row, out[k].data() + first);
    });
    return;
  }
  std::vector<const float*> first, second;
  std::vector<float*> to;
  for (std::size_t chip = 0; chip < readers.size(); ++chip) {
    first.push_back(in.first->planes[chip].data());
    second.push_back(in.second->planes[chip].data());
  }
  for (Plane& plane : out) to.push_back(plane.data());
  in.carrier->planes(first, second, parts, to, CarrySide::both, fine);
  for (std::size_t k = 0; k < out.size(); ++k)
    in.residuals[k % readers.size()].apply(parts[k / readers.size()], std::span(out[k]).first(fine_pixels()),
                                           static_cast<std::size_t>(fine.begin) * row,
                                           static_cast<std::size_t>(fine.end) * row);
}

void LightInTime::Work::planes(std::int64_t frame, std::span<const double> parts, Region rows, const Give& give) {
  const std::size_t chips = readers.size(), width = static_cast<std::size_t>(info().width);
  const bool fine = side() > 1;
  Plane mean(fine ? pixels() : 0);
  const auto give_fine = [&](std::size_t part, std::size_t chip, const Plane& plane) {
    if (!fine) return give(part, chip, plane);
    const std::size_t begin = static_cast<std::size_t>(rows.begin) * width;
    average_squares(std::span(plane).subspan(begin * side2()), info().file_width(), side(),
                    std::span(mean).subspan(begin, static_cast<std::size_t>(rows.end - rows.begin) * width));
    give(part, chip, mean);
  };
  const std::size_t room = std::max<std::size_t>(1, kBatchBytes / (sizeof(float) * fine_pixels() * chips));
  for (std::size_t begin = 0; begin < parts.size();) {
    if (parts[begin] == 0) {
      const auto key = keyframe(frame);
      for (std::size_t chip = 0; chip < chips; ++chip) give_fine(begin, chip, key->planes[chip]);
      ++begin;
      continue;
    }
    std::size_t count = 1;
    while (count < room && begin + count < parts.size() && parts[begin + count] != 0) ++count;
    if (scratch.size() < count * chips) scratch.resize(count * chips, Plane(fine_pixels() + motion::kSpare));
    const auto out = std::span(scratch).first(count * chips);
    carry(interval(frame), parts.subspan(begin, count), rows, out);
    for (std::size_t k = 0; k < out.size(); ++k) give_fine(begin + k / chips, k % chips, out[k]);
    begin += count;
  }
}

// For half a pixel of motion between the steps, not closer than a microsecond.
std::int64_t LightInTime::Work::steps_of(const Exposure& exposure, double from_us, double to_us) {
  if (exposure.steps > 0) return exposure.steps;
  double most = 0;  // per us
  for (double t_us = from_us; t_us < to_us;) {
    const std::int64_t frame = place(t_us).frame;
    if (frame + 1 == source.frames() && !info().period_ns) break;
    double& known = steps_per_us[static_cast<std::size_t>(frame)];
    if (std::isnan(known)) interval(frame);
    most = std::max(most, known);
    const double length_us = 1e-3 * static_cast<double>(begin_ns(frame + 1) - begin_ns(frame));
    t_us += std::max(1e-2, length_us * (1 - place(t_us).part));
  }
  const double wanted = std::ceil(most * exposure.exposure_us - 1e-9);
  return static_cast<std::int64_t>(
      std::clamp(wanted, 1.0, std::clamp(exposure.exposure_us, 1.0, static_cast<double>(kMostSteps))));
}

std::vector<Cell> LightInTime::Work::cells(const Exposure& exposure, std::int64_t steps, double from_us,
                                           double to_us) const {
  const double length_us = exposure.exposure_us / static_cast<double>(steps);
  const double per_row = exposure.row_delay_us / length_us, last = per_row * (info().height - 1);
  constexpr double kNothing = 1e-9;  // of a cell
  if (!(std::abs(last) + static_cast<double>(steps) <= kMostCells))
    throw bad_input(
        source.name(), "exposure",
        fmt::format("{} steps in {} us, rows {} us apart", steps, exposure.exposure_us, exposure.row_delay_us),
        fmt::format("at most {} steps from the first row's begin to the last row's end", kMostCells));
  const auto begin = static_cast<std::int64_t>(std::floor(std::min(0.0, last) + kNothing));
  const auto end = static_cast<std::int64_t>(std::ceil(std::max(0.0, last) - kNothing)) + steps;
  std::vector<Cell> out;
  for (std::int64_t k = begin; k < end; ++k) {
    const auto at = static_cast<double>(k);
    // Rows whose exposure, from per_row * y to that + steps, overlaps the cell.
    const auto overlaps = [&](int y) {
      return per_row * y < at + 1 - kNothing && per_row * y + static_cast<double>(steps) > at + kNothing;
    };
    const double first_row = per_row == 0  ? 0
                             : per_row > 0 ? (at + kNothing - static_cast<double>(steps)) / per_row
                                           : (at + 1 - kNothing) / per_row;
    int y = static_cast<int>(std::clamp(std::floor(first_row), 0.0, static_cast<double>(info().height)));
    for (const int latest = std::min(info().height, y + 2); y < latest && !overlaps(y);) ++y;
    Region rows{y, y};
    while (rows.end < info().height && overlaps(rows.end)) ++rows.end;
    const double middle_us = exposure.begin_us + (at + 0.5) * length_us;
    if (rows.begin < rows.end) out.push_back({place(std::clamp(middle_us, from_us, to_us)), rows, at});
  }
  return out;
}

LightInTime::LightInTime(const FrameSource& source, std::span<const std::vector<double>> amperes, bool along_motion)
    : work_(new Work{source, {}, along_motion && source.has_motion()}) {
  for (const std::vector<double>& one : amperes)
    work_->readers.push_back(std::make_unique<PhotocurrentReader>(source, one));
  const std::int64_t frames = source.frames(), planned = std::ssize(source.info().times_ns);
  if (frames < 1 || (source.info().period_ns && frames < planned))
    throw bad_input(source.name(), "frames", fmt::format("{} so far", frames),
                    fmt::format("the {} of times_ns", planned));
  work_->steps_per_us.assign(static_cast<std::size_t>(frames), std::numeric_limits<double>::quiet_NaN());
}

LightInTime::~LightInTime() = default;

std::size_t LightInTime::chips() const { return work_->readers.size(); }
std::size_t LightInTime::values() const { return chips() * work_->pixels(); }
bool LightInTime::along_motion() const { return work_->along_motion; }
double LightInTime::end_us() const { return work_->end_us(); }

void LightInTime::at(std::span<const double> t_us, std::span<float> out) {
  std::vector<Place> places;
  for (const double t : t_us) places.push_back(work_->place(t));
  const Region all{0, work_->info().height};
  for (std::size_t begin = 0; begin < places.size();) {
    std::vector<double> parts;
    while (begin + parts.size() < places.size() && places[begin + parts.size()].frame == places[begin].frame)
      parts.push_back(places[begin + parts.size()].part);
    work_->planes(places[begin].frame, parts, all, [&](std::size_t k, std::size_t chip, std::span<const float> plane) {
      float* to = out.data() + (begin + k) * values() + chip * work_->pixels();
      for (std::size_t i = 0; i < work_->pixels(); ++i) to[i] = plane[i] * 1e-15f;
    });
    begin += parts.size();
  }
}

void LightInTime::exposure(const Exposure& exposure, std::span<float> out) {
  if (!(exposure.exposure_us > 0 && std::isfinite(exposure.exposure_us)))
    throw bad_input(work_->source.name(), "exposure_us", fmt::format("{}", exposure.exposure_us), "more than 0");
  if (!std::isfinite(exposure.row_delay_us) || exposure.steps < 0 || exposure.steps > kMostSteps)
    throw bad_input(work_->source.name(), "exposure",
                    fmt::format("row_delay_us {}, steps {}", exposure.row_delay_us, exposure.steps),
                    fmt::format("a finite delay, 0 to {} steps", kMostSteps));
  const int height = work_->info().height;
  const double last_us = exposure.row_delay_us * (height - 1);
  const double from_us = exposure.begin_us + std::min(0.0, last_us),
               to_us = exposure.begin_us + std::max(0.0, last_us) + exposure.exposure_us;
  work_->place(from_us), work_->place(to_us);
  const std::int64_t steps = work_->steps_of(exposure, from_us, to_us);
  const std::vector<Cell> cells = work_->cells(exposure, steps, from_us, to_us);
  const double per_row = exposure.row_delay_us * static_cast<double>(steps) / exposure.exposure_us;

  // Cells that follow each other are computed together, with the rows that any of them needs.
  const std::size_t most = exposure.row_delay_us == 0 ? cells.size() : static_cast<std::size_t>(steps / 4 + 1);
  const auto width = static_cast<std::size_t>(work_->info().width);
  std::vector<double> sums(values());
  for (std::size_t begin = 0; begin < cells.size();) {
    std::vector<double> parts;
    Region rows = cells[begin].rows;
    for (std::size_t k = begin; k < cells.size() && parts.size() < most; ++k) {
      if (cells[k].place.frame != cells[begin].place.frame) break;
      rows = {std::min(rows.begin, cells[k].rows.begin), std::max(rows.end, cells[k].rows.end)};
      parts.push_back(cells[k].place.part);
    }
    const auto add = [&](std::size_t k, std::size_t chip, std::span<const float> plane) {
      const Cell& cell = cells[begin + k];
      tbb::parallel_for(cell.rows.begin, cell.rows.end, [&](int y) {
        const double row = per_row * y;
        const double weight = std::min(cell.at + 1, row + static_cast<double>(steps)) - std::max(cell.at, row);
        double* to = sums.data() + chip * work_->pixels() + static_cast<std::size_t>(y) * width;
        const float* from = plane.data() + static_cast<std::size_t>(y) * width;
        for (std::size_t x = 0; x < width; ++x) to[x] += weight * from[x];
      });
    };
    work_->planes(cells[begin].place.frame, parts, rows, add);
    begin += parts.size();
  }
  for (std::size_t i = 0; i < sums.size(); ++i)
    out[i] = static_cast<float>(sums[i] / static_cast<double>(steps) * 1e-15);
}

}  // namespace pecs::sensor
