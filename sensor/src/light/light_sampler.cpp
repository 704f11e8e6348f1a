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

// Light at a time within the interval that begins at a frame; fraction 0: at the frame itself.
struct Sample {
  std::int64_t frame = 0;
  double fraction = 0;
  Region rows{};     // that are needed
  double begin = 0;  // of an exposure's cell, in cells from the exposure's begin
};

}  // namespace

struct LightSampler::Impl {
  Impl(const FrameSource& of, std::span<const Response> chips, bool along)
      : source(of),
        readers(readers_of(of, chips)),
        along_motion(along),
        intervals(pointers_to(readers), along, 2),
        moving(info().width, info().height, along ? info().subpixels : 1, mosaics_of(readers, along)),
        steps_per_us(static_cast<std::size_t>(of.frames()), std::numeric_limits<double>::quiet_NaN()) {}

  using Readers = std::vector<std::unique_ptr<PhotocurrentReader>>;
  static Readers readers_of(const FrameSource& source, std::span<const Response> chips) {
    Readers readers;
    for (const Response& chip : chips) readers.push_back(std::make_unique<PhotocurrentReader>(source, chip));
    return readers;
  }
  static std::vector<PhotocurrentReader*> pointers_to(const Readers& readers) {
    std::vector<PhotocurrentReader*> pointers;
    for (const auto& reader : readers) pointers.push_back(reader.get());
    return pointers;
  }

  // Light that is blended at the pixel is read behind each pixel's filter.
  static std::vector<const Mosaic*> mosaics_of(const Readers& readers, bool along_motion) {
    std::vector<const Mosaic*> mosaics;
    for (const auto& reader : readers) mosaics.push_back(along_motion ? reader->mosaic() : nullptr);
    return mosaics;
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
  Sample sample(double t_us) const;
  template <class Sink>
  void planes(std::span<const Sample> samples, std::size_t together, const Sink& sink);
  double steps_per_us_of(std::int64_t frame);
  std::int64_t steps_of(const Exposure& exposure, double from_us, double to_us);
  std::vector<Sample> cells(const Exposure& exposure, std::int64_t steps, double from_us, double to_us) const;

  const FrameSource& source;
  Readers readers;
  bool along_motion;
  IntervalReader intervals;
  MovingLight moving;
  std::vector<double> steps_per_us;  // of each interval; NaN: not known yet
};

// All rows at a time.
Sample LightSampler::Impl::sample(double t_us) const {
  constexpr double kSame_ns = 0.5;
  double t_ns = t_us * 1e3;
  if (!(t_ns >= -kSame_ns) || t_us > end_us() + 1e-3 * kSame_ns)
    throw bad_input(source.name(), "t_us", fmt::format("{}", t_us),
                    info().period_ns ? "0 or more" : fmt::format("0 to {}", end_us()));
  if (info().period_ns) t_ns = std::fmod(std::max(t_ns, 0.0), static_cast<double>(*info().period_ns));
  const auto times_ns = std::span(info().times_ns).first(static_cast<std::size_t>(source.frames()));
  const auto since_start = [&](std::int64_t time_ns) { return static_cast<double>(time_ns - times_ns[0]); };
  const std::int64_t frame =
      std::ranges::upper_bound(times_ns, t_ns + kSame_ns, {}, since_start) - times_ns.begin() - 1;
  const Region all{0, info().height};
  const double since_ns = t_ns - static_cast<double>(begin_ns(frame));
  const bool is_last = frame + 1 == source.frames();
  if (since_ns <= kSame_ns || (is_last && !info().period_ns)) return {frame, 0, all};
  const auto length_ns = static_cast<double>(begin_ns(frame + 1) - begin_ns(frame));
  if (length_ns - since_ns <= kSame_ns) return {is_last ? 0 : frame + 1, 0, all};
  return {frame, since_ns / length_ns, all};
}

// sink(k, planes) gets planes [sample][chip] of the samples from the k-th on. Up to `together` samples that follow each
// other in one interval are computed together, with the rows that any of them needs.
template <class Sink>
void LightSampler::Impl::planes(std::span<const Sample> samples, std::size_t together, const Sink& sink) {
  for (std::size_t begin = 0; begin < samples.size();) {
    const std::int64_t frame = samples[begin].frame;
    std::vector<double> fractions;
    Region rows = samples[begin].rows;
    for (const Sample& s : samples.subspan(begin)) {
      if (s.frame != frame || fractions.size() == together) break;
      rows = {std::min(rows.begin, s.rows.begin), std::max(rows.end, s.rows.end)};
      fractions.push_back(s.fraction);
    }
    const bool between = std::ranges::any_of(fractions, [](double s) { return s != 0; });
    moving.planes(*(between ? intervals.interval(frame) : intervals.frame(frame)), fractions, rows,
                  [&](std::size_t k, std::span<const float* const> planes) {
                    sink(begin + k, planes);
                    return true;
                  });
    begin += fractions.size();
  }
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
    const Sample at = sample(t_us);
    if (at.frame + 1 == source.frames() && !info().period_ns) break;
    most_per_us = std::max(most_per_us, steps_per_us_of(at.frame));
    t_us += std::max(1e-2, length_us(at.frame) * (1 - at.fraction));
  }
  const double wanted = std::ceil(most_per_us * exposure.exposure_us - 1e-9);
  return static_cast<std::int64_t>(
      std::clamp(wanted, 1.0, std::clamp(exposure.exposure_us, 1.0, static_cast<double>(kMostSteps))));
}

std::vector<Sample> LightSampler::Impl::cells(const Exposure& exposure, std::int64_t steps, double from_us,
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
  const auto row = [&](double y) { return static_cast<int>(std::clamp<double>(y, 0, info().height)); };
  std::vector<Sample> out;
  for (std::int64_t k = begin; k < end; ++k) {
    const auto at = static_cast<double>(k);
    // Rows y whose exposure, from per_row * y to that + count, overlaps the cell.
    const auto [after, before] = std::minmax({(at + kNothing - count) / per_row, (at + 1 - kNothing) / per_row});
    Sample cell = sample(std::clamp(exposure.begin_us + (at + 0.5) * cell_us, from_us, to_us));
    if (per_row != 0) cell.rows = {row(std::floor(after) + 1), row(std::ceil(before))};
    cell.begin = at;
    if (cell.rows.begin < cell.rows.end) out.push_back(cell);
  }
  return out;
}

LightSampler::LightSampler(const FrameSource& source, std::span<const Response> chips, bool along_motion) {
  const std::int64_t frames = source.frames(), planned = std::ssize(source.info().times_ns);
  if (frames < 1 || (source.info().period_ns && frames < planned))
    throw bad_input(source.name(), "frames", fmt::format("{} so far", frames),
                    fmt::format("the {} of times_ns", planned));
  impl_ = std::make_unique<Impl>(source, chips, along_motion && source.has_motion());
}

LightSampler::~LightSampler() = default;

std::size_t LightSampler::chips() const { return impl_->readers.size(); }
std::size_t LightSampler::values() const { return chips() * impl_->pixels(); }
bool LightSampler::along_motion() const { return impl_->along_motion; }
double LightSampler::end_us() const { return impl_->end_us(); }

void LightSampler::at(std::span<const double> t_us, std::span<float> out) {
  std::vector<Sample> samples;
  for (const double t : t_us) samples.push_back(impl_->sample(t));
  impl_->planes(samples, samples.size(), [&](std::size_t k, std::span<const float* const> planes) {
    float* to = out.data() + k * values();
    for (const float* plane : planes)
      to = std::transform(plane, plane + impl_->pixels(), to, [](float fa) { return fa * 1e-15f; });
  });
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
  impl_->sample(from_us), impl_->sample(to_us);  // throw for times outside the source's
  const std::int64_t steps = impl_->steps_of(exposure, from_us, to_us);
  const std::vector<Sample> cells = impl_->cells(exposure, steps, from_us, to_us);
  const double per_row = exposure.row_delay_us * static_cast<double>(steps) / exposure.exposure_us;
  const std::size_t together = exposure.row_delay_us == 0 ? cells.size() : static_cast<std::size_t>(steps / 4 + 1);
  const auto width = static_cast<std::size_t>(impl_->info().width);
  std::vector<double> sums(values());
  impl_->planes(cells, together, [&](std::size_t first, std::span<const float* const> planes) {
    for (std::size_t i = 0; i < planes.size(); ++i) {
      const Sample& cell = cells[first + i / chips()];
      double* const sum = sums.data() + i % chips() * impl_->pixels();
      tbb::parallel_for(cell.rows.begin, cell.rows.end, [&](int y) {
        const double row = per_row * y;
        const double weight = std::min(cell.begin + 1, row + static_cast<double>(steps)) - std::max(cell.begin, row);
        const std::size_t begin = static_cast<std::size_t>(y) * width;
        for (std::size_t k = begin; k < begin + width; ++k) sum[k] += weight * planes[i][k];
      });
    }
  });
  for (std::size_t i = 0; i < sums.size(); ++i)
    out[i] = static_cast<float>(sums[i] / static_cast<double>(steps) * 1e-15);
}

}  // namespace pecs::sensor
