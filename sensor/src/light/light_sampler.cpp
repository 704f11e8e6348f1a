#include "pecs/sensor/light_sampler.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "light/moving_light.h"
#include "pecs/error.h"

namespace pecs::sensor {
namespace {

// A time within the interval that begins at a frame; fraction 0: the frame itself.
struct FramePosition {
  std::int64_t frame = 0;
  double fraction = 0;
};

// One sample of an exposure.
struct ExposureCell {
  FramePosition position;
  Region rows;       // that are exposed then
  double begin = 0;  // in cells from the exposure's begin
};

}  // namespace

struct LightSampler::Impl {
  Impl(const FrameSource& of, std::span<const std::vector<double>> amperes, bool along)
      : source(of),
        readers(readers_of(of, amperes)),
        along_motion(along),
        intervals(pointers_to(readers), along, 2),
        moving(info().width, info().height, along ? info().subpixels : 1, readers.size()),
        steps_per_us(static_cast<std::size_t>(of.frames()), std::numeric_limits<double>::quiet_NaN()) {}

  using Readers = std::vector<std::unique_ptr<PhotocurrentReader>>;
  static Readers readers_of(const FrameSource& source, std::span<const std::vector<double>> amperes) {
    Readers readers;
    for (const auto& chip : amperes) readers.push_back(std::make_unique<PhotocurrentReader>(source, chip));
    return readers;
  }
  static std::vector<PhotocurrentReader*> pointers_to(const Readers& readers) {
    std::vector<PhotocurrentReader*> pointers;
    for (const auto& reader : readers) pointers.push_back(reader.get());
    return pointers;
  }

  const StackInfo& info() const { return source.info(); }
  std::size_t pixels() const {
    return static_cast<std::size_t>(info().width) * static_cast<std::size_t>(info().height);
  }
  std::int64_t begin_ns(std::int64_t frame) const {
    const auto& times = info().times_ns;
    return frame < source.frames() ? times[static_cast<std::size_t>(frame)] - times[0] : info().period_ns.value_or(0);
  }
  double length_us(std::int64_t frame) const {
    return 1e-3 * static_cast<double>(begin_ns(frame + 1) - begin_ns(frame));
  }
  double end_us() const {
    return info().period_ns ? std::numeric_limits<double>::infinity()
                            : static_cast<double>(begin_ns(source.frames() - 1)) * 1e-3;
  }
  FramePosition position(double t_us) const;
  void planes(std::int64_t frame, std::span<const double> fractions, Region rows, const MovingLight::Sink& sink);
  double steps_per_us_of(std::int64_t frame);
  std::int64_t steps_of(const Exposure& exposure, double from_us, double to_us);
  std::vector<ExposureCell> cells(const Exposure& exposure, std::int64_t steps, double from_us, double to_us) const;

  const FrameSource& source;
  Readers readers;
  bool along_motion;
  IntervalReader intervals;
  MovingLight moving;
  std::vector<double> steps_per_us;  // of each interval; NaN: not known yet
};

FramePosition LightSampler::Impl::position(double t_us) const {
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

void LightSampler::Impl::planes(std::int64_t frame, std::span<const double> fractions, Region rows,
                                const MovingLight::Sink& sink) {
  const bool between = std::ranges::any_of(fractions, [](double s) { return s != 0; });
  moving.planes(*(between ? intervals.interval(frame) : intervals.frame(frame)), fractions, rows, sink);
}

// So that nothing moves more than half a pixel from step to step, and no picture between frames is missed.
double LightSampler::Impl::steps_per_us_of(std::int64_t frame) {
  double& known = steps_per_us[static_cast<std::size_t>(frame)];
  if (std::isnan(known)) {
    constexpr double kWithoutMotion = 4;
    const auto interval = intervals.interval(frame);
    const double steps = interval->carrier ? std::max(interval->carrier->longest_path_px() / (0.5 * info().subpixels),
                                                      static_cast<double>(interval->pictures.size() + 1))
                                           : kWithoutMotion;
    known = steps / length_us(frame);
  }
  return known;
}

// At most one a microsecond, unless they were asked for.
std::int64_t LightSampler::Impl::steps_of(const Exposure& exposure, double from_us, double to_us) {
  if (exposure.steps > 0) return exposure.steps;
  double most_per_us = 0;
  for (double t_us = from_us; t_us < to_us;) {
    const FramePosition at = position(t_us);
    if (at.frame + 1 == source.frames() && !info().period_ns) break;
    most_per_us = std::max(most_per_us, steps_per_us_of(at.frame));
    t_us += std::max(1e-2, length_us(at.frame) * (1 - at.fraction));
  }
  const double wanted = std::ceil(most_per_us * exposure.exposure_us - 1e-9);
  return static_cast<std::int64_t>(
      std::clamp(wanted, 1.0, std::clamp(exposure.exposure_us, 1.0, static_cast<double>(kMostSteps))));
}

std::vector<ExposureCell> LightSampler::Impl::cells(const Exposure& exposure, std::int64_t steps, double from_us,
                                                    double to_us) const {
  const double cell_us = exposure.exposure_us / static_cast<double>(steps), count = static_cast<double>(steps);
  const double per_row = exposure.row_delay_us / cell_us, last = per_row * (info().height - 1);
  if (!(std::abs(last) + count <= kMostCells))
    throw bad_input(
        source.name(), "exposure",
        fmt::format("{} steps in {} us, rows {} us apart", steps, exposure.exposure_us, exposure.row_delay_us),
        fmt::format("at most {} steps from the first row's begin to the last row's end", kMostCells));
  constexpr double kNothing = 1e-9;  // of a cell
  const auto begin = static_cast<std::int64_t>(std::floor(std::min(0.0, last) + kNothing));
  const auto end = static_cast<std::int64_t>(std::ceil(std::max(0.0, last) - kNothing)) + steps;
  std::vector<ExposureCell> out;
  for (std::int64_t k = begin; k < end; ++k) {
    const auto at = static_cast<double>(k);
    // Rows whose exposure, from per_row * y to that + steps, overlaps the cell: they follow each other.
    const auto overlaps = [&](int y) { return per_row * y < at + 1 - kNothing && per_row * y + count > at + kNothing; };
    const double first_row = per_row == 0  ? 0
                             : per_row > 0 ? (at + kNothing - count) / per_row
                                           : (at + 1 - kNothing) / per_row;
    int y = static_cast<int>(std::clamp(std::floor(first_row), 0.0, static_cast<double>(info().height)));
    for (const int latest = std::min(info().height, y + 2); y < latest && !overlaps(y);) ++y;
    Region rows{y, y};
    while (rows.end < info().height && overlaps(rows.end)) ++rows.end;
    const double middle_us = exposure.begin_us + (at + 0.5) * cell_us;
    if (rows.begin < rows.end) out.push_back({position(std::clamp(middle_us, from_us, to_us)), rows, at});
  }
  return out;
}

LightSampler::LightSampler(const FrameSource& source, std::span<const std::vector<double>> amperes, bool along_motion) {
  const std::int64_t frames = source.frames(), planned = std::ssize(source.info().times_ns);
  if (frames < 1 || (source.info().period_ns && frames < planned))
    throw bad_input(source.name(), "frames", fmt::format("{} so far", frames),
                    fmt::format("the {} of times_ns", planned));
  impl_ = std::make_unique<Impl>(source, amperes, along_motion && source.has_motion());
}

LightSampler::~LightSampler() = default;

std::size_t LightSampler::chips() const { return impl_->readers.size(); }
std::size_t LightSampler::values() const { return chips() * impl_->pixels(); }
bool LightSampler::along_motion() const { return impl_->along_motion; }
double LightSampler::end_us() const { return impl_->end_us(); }

void LightSampler::at(std::span<const double> t_us, std::span<float> out) {
  std::vector<FramePosition> positions;
  for (const double t : t_us) positions.push_back(impl_->position(t));
  const Region all{0, impl_->info().height};
  for (std::size_t begin = 0; begin < positions.size();) {
    std::vector<double> fractions;
    while (begin + fractions.size() < positions.size() &&
           positions[begin + fractions.size()].frame == positions[begin].frame)
      fractions.push_back(positions[begin + fractions.size()].fraction);
    impl_->planes(positions[begin].frame, fractions, all, [&](std::size_t k, std::span<const float* const> planes) {
      float* to = out.data() + (begin + k) * values();
      for (const float* plane : planes)
        to = std::transform(plane, plane + impl_->pixels(), to, [](float fa) { return fa * 1e-15f; });
      return true;
    });
    begin += fractions.size();
  }
}

void LightSampler::exposure(const Exposure& exposure, std::span<float> out) {
  if (!(exposure.exposure_us > 0 && std::isfinite(exposure.exposure_us)))
    throw bad_input(impl_->source.name(), "exposure_us", fmt::format("{}", exposure.exposure_us), "more than 0");
  if (!std::isfinite(exposure.row_delay_us) || exposure.steps < 0 || exposure.steps > kMostSteps)
    throw bad_input(impl_->source.name(), "exposure",
                    fmt::format("row_delay_us {}, steps {}", exposure.row_delay_us, exposure.steps),
                    fmt::format("a finite delay, 0 to {} steps", kMostSteps));
  const double last_us = exposure.row_delay_us * (impl_->info().height - 1);
  const double from_us = exposure.begin_us + std::min(0.0, last_us),
               to_us = exposure.begin_us + std::max(0.0, last_us) + exposure.exposure_us;
  impl_->position(from_us), impl_->position(to_us);
  const std::int64_t steps = impl_->steps_of(exposure, from_us, to_us);
  const std::vector<ExposureCell> cells = impl_->cells(exposure, steps, from_us, to_us);
  const double per_row = exposure.row_delay_us * static_cast<double>(steps) / exposure.exposure_us;

  // Cells that follow each other are computed together, with the rows that any of them needs.
  const std::size_t most = exposure.row_delay_us == 0 ? cells.size() : static_cast<std::size_t>(steps / 4 + 1);
  const auto width = static_cast<std::size_t>(impl_->info().width);
  std::vector<double> sums(values());
  for (std::size_t begin = 0; begin < cells.size();) {
    std::vector<double> fractions;
    Region rows = cells[begin].rows;
    for (std::size_t k = begin; k < cells.size() && fractions.size() < most; ++k) {
      if (cells[k].position.frame != cells[begin].position.frame) break;
      rows = {std::min(rows.begin, cells[k].rows.begin), std::max(rows.end, cells[k].rows.end)};
      fractions.push_back(cells[k].position.fraction);
    }
    const auto add = [&](const ExposureCell& cell, const float* plane, double* sum) {
      tbb::parallel_for(cell.rows.begin, cell.rows.end, [&](int y) {
        const double row = per_row * y;
        const double weight = std::min(cell.begin + 1, row + static_cast<double>(steps)) - std::max(cell.begin, row);
        const std::size_t first = static_cast<std::size_t>(y) * width;
        for (std::size_t i = first; i < first + width; ++i) sum[i] += weight * plane[i];
      });
    };
    impl_->planes(cells[begin].position.frame, fractions, rows,
                  [&](std::size_t first, std::span<const float* const> planes) {
                    for (std::size_t i = 0; i < planes.size(); ++i)
                      add(cells[begin + first + i / chips()], planes[i], sums.data() + i % chips() * impl_->pixels());
                    return true;
                  });
    begin += fractions.size();
  }
  for (std::size_t i = 0; i < sums.size(); ++i)
    out[i] = static_cast<float>(sums[i] / static_cast<double>(steps) * 1e-15);
}

}  // namespace pecs::sensor
