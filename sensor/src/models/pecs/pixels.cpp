#include "models/pecs/pixels.h"

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "models/pecs/amplifier.h"
#include "models/pecs/kernel.h"
#include "pecs/error.h"
#include "pecs/sensor/random.h"

namespace pecs::sensor {
namespace {

constexpr double kMinThreshold = 0.1;           // relative to the nominal one: lower bound with mismatch
constexpr double kMaxInterval_us = 1e9;         // times within an interval have 32 bits in the kernels
constexpr double kBackgroundWindow_us = 65536;  // background events are drawn per block of pixels and window

// Poisson deviate by inversion in chunks small enough for exp(-mean); `next` gives uniforms in (0, 1).
template <class Next>
int poisson(double mean, Next&& next) {
  int count = 0;
  for (; mean > 0; mean -= 16) {
    const double floor = std::exp(-std::min(mean, 16.0));
    for (double product = next(); product > floor; product *= next()) ++count;
  }
  return count;
}

IntervalTimes interval_times(const std::vector<double>& t_us, std::size_t i, std::int64_t step,
                             const PixelConstants& constants) {
  const double h0 = t_us[i + 1] - t_us[i], h1 = i + 2 < t_us.size() ? t_us[i + 2] - t_us[i + 1] : h0;
  if (h0 > kMaxInterval_us)
    throw bad_input("frames", fmt::format("time after {} us", t_us[i]), fmt::format("{} us", h0),
                    fmt::format("at most {} us between frames", kMaxInterval_us));
  const auto leaked = [&](double t) { return std::round(t * constants.leak_per_us / kLeakUnit) * kLeakUnit; };
  return {t_us[i],
          t_us[i + 1],
          static_cast<float>(h0),
          static_cast<float>(1 / h0),
          static_cast<float>(1 / h1),
          static_cast<float>(leaked(t_us[i + 1]) - leaked(t_us[i])),
          {h0, h1},
          step,
          constants.b_per_us > 0 ? scalar::amplifier_weights(constants.b_per_us * h0) : AmplifierWeights{}};
}

}  // namespace

PecsPixels::PecsPixels(const ModelSetup& setup)
    : dark_fa_(setup.chip.dark_current_a * 1e15),
      gain_fa_(setup.per_unit),
      noise_std_(setup.chip.noise_std),
      background_on_hz_(setup.chip.background_on_hz),
      background_off_hz_(setup.chip.background_off_hz),
      seed_(setup.seed),
      noise_seed_(setup.noise_seed),
      random_phase_(setup.random_phase),
      takes_frames_(setup.chip.takes_frames && setup.chip.frame_step + setup.chip.frame_step_slow > 0),
      exposures_{{},
                 setup.chip.frame_row_s * 1e6,
                 static_cast<std::uint32_t>(setup.width),
                 setup.chip.frame_step,
                 setup.chip.frame_step_spread,
                 setup.chip.frame_step_slow,
                 setup.chip.frame_step_slow_s * 1e6},
      map_(setup.chip.pixel_map),
      width_(static_cast<std::uint32_t>(setup.width)) {
  const Chip& chip = setup.chip;
  if (map_ && (map_->x + map_->width > setup.width || map_->y + map_->height > setup.height))
    throw bad_input(map_->file, "region", fmt::format("{},{},{},{}", map_->x, map_->y, map_->width, map_->height),
                    fmt::format("a region within the frames' {}x{}", setup.width, setup.height));
  if (chip.corner_hz_per_a == 0 && chip.noise_std > 0)
    throw bad_input("chip " + chip.name, "noise_std", "noise without a photoreceptor", "corner_hz_per_a > 0");
  if (chip.amplifier_cutoff_hz == 0 && chip.noise_std > 0)  // one pole's noise crosses any level infinitely often
    throw bad_input("chip " + chip.name, "noise_std", "noise without an amplifier",
                    "amplifier_cutoff_hz > 0, or noise_std 0");
  if (chip.corner_hz_per_a == 0 && chip.amplifier_cutoff_hz > 0)
    throw bad_input("chip " + chip.name, "amplifier_cutoff_hz", "an amplifier without a photoreceptor",
                    "corner_hz_per_a > 0, or amplifier_cutoff_hz 0");
  constants_.b_per_us = 2 * std::numbers::pi * chip.amplifier_cutoff_hz * 1e-6;
  constants_.a_per_us = 2 * std::numbers::pi * chip.corner_hz_per_a * 1e-15 * 1e-6;
  constants_.leak_per_us = chip.leak_rate_hz * chip.contrast_threshold_on * 1e-6;
  constants_.refractory_us = chip.refractory_period_s * 1e6;

  const std::size_t n = setup.pixels(), padded = n + kMaxLanes;
  draw_thresholds(chip, n);
  place_hot_pixels(chip, setup.height);
  for (Zeros* row : {&light0_, &light1_, &m0_, &reference_}) *row = Zeros(padded);
  if (setup.causes && !has_thresholds_only()) marks_.resize(n);
  if (!has_thresholds_only()) blind_us_ = Zeros(padded);
  if (constants_.a_per_us > 0) w_ = Zeros(padded);
  if (constants_.b_per_us > 0) y_ = Zeros(padded);
  if (takes_frames_ && exposures_.slow > 0) e_ = Zeros(padded);
  if (noise_std_ > 0)
    for (Zeros* row : {&n_, &z_}) *row = Zeros(padded);
}

void PecsPixels::draw_thresholds(const Chip& chip, std::size_t pixels) {
  equal_thresholds_ = chip.threshold_mismatch == 0 && !maps_thresholds();
  for (Zeros* row : {&threshold_on_, &threshold_off_}) *row = Zeros((equal_thresholds_ ? 0 : pixels) + kMaxLanes);
  const auto draw = [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const auto pixel = static_cast<std::uint32_t>(i);
      const Random4 r = equal_thresholds_ ? Random4{} : random_of(pixel);
      const auto index = maps_thresholds() ? mapped(pixel) : std::nullopt;
      const auto threshold = [&](double nominal, const std::vector<float>* map, std::uint32_t word) {
        const double mismatch = equal_thresholds_ ? 0 : chip.threshold_mismatch * gaussian(word);
        return static_cast<float>(nominal * (index ? (*map)[*index] : std::max(kMinThreshold, 1 + mismatch)));
      };
      threshold_on_.data()[i] = threshold(chip.contrast_threshold_on, map_ ? &map_->threshold_on : nullptr, r[0]);
      threshold_off_.data()[i] = threshold(chip.contrast_threshold_off, map_ ? &map_->threshold_off : nullptr, r[1]);
    }
  };
  if (equal_thresholds_)
    draw(0, kMaxLanes);
  else
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, pixels, kBlock),
                      [&](const auto& range) { draw(range.begin(), range.end()); });
  for (const Zeros* row : {&threshold_on_, &threshold_off_})
    if (!equal_thresholds_) std::fill_n(row->data() + pixels, kMaxLanes, 1.0f);
}

void PecsPixels::place_hot_pixels(const Chip& chip, int height) {
  if (map_ && map_->hot_pixels) {
    for (const auto& [x, y, hz] : *map_->hot_pixels) {
      if (static_cast<std::uint32_t>(x) >= width_ || y >= height)
        throw bad_input(map_->file, "hot_pixels", fmt::format("pixel {},{}", x, y),
                        fmt::format("pixels within the frames' {}x{}", width_, height));
      hot_.push_back({static_cast<std::uint32_t>(y) * width_ + static_cast<std::uint32_t>(x), hz});
    }
    std::ranges::sort(hot_, {}, &HotPixel::pixel);
    return;
  }
  const std::uint32_t pixels = width_ * static_cast<std::uint32_t>(height);
  for (std::uint32_t i = 0; chip.hot_pixel_fraction > 0 && chip.hot_pixel_hz > 0 && i < pixels; ++i)
    if (uniform(random_of(i)[2]) < chip.hot_pixel_fraction) hot_.push_back({i, chip.hot_pixel_hz});
}

Random4 PecsPixels::random_of(std::uint32_t pixel) const { return random4(seed_, pixel, 0, Purpose::threshold); }

std::optional<std::size_t> PecsPixels::mapped(std::uint32_t pixel) const {
  return map_->index(static_cast<int>(pixel % width_), static_cast<int>(pixel / width_), uniform(random_of(pixel)[3]));
}

// True without photoreceptor, refractory period, leak, due events and random phases: all events are signal.
bool PecsPixels::has_thresholds_only() const {
  return constants_.a_per_us == 0 && constants_.leak_per_us == 0 && constants_.refractory_us == 0 &&
         !has_due_events() && !random_phase_;
}

void PecsPixels::advance(const FrameBatch& batch, PixelRange range, EventSlots& events) {
  // Interval i lies between t_us[i] and t_us[i + 1]; it needs t_us[i + 2], or the end of the stream.
  const std::size_t times = batch.t_us.size();
  const std::size_t complete = times < 2 ? 0 : times - (batch.last ? 1 : 2);
  const std::int64_t first_step = std::max<std::int64_t>(0, batch.first_frame - 2);
  std::vector<IntervalTimes> intervals;
  for (std::size_t i = 0; i < complete; ++i)
    intervals.push_back(interval_times(batch.t_us, i, first_step + static_cast<std::int64_t>(i), constants_));

  std::vector<BackgroundEvent> noise;
  if (complete && has_background()) noise = background(batch.t_us[0], batch.t_us[complete], range);
  ExposureSteps exposures = exposures_;
  std::vector<ExposureStep> steps;
  for (const auto& [frame, begin_us, end_us] : batch.exposures)
    if (takes_frames_) steps.insert(steps.end(), {{begin_us, frame, false}, {end_us, frame, true}});
  exposures.steps = steps;
  const auto run = has_thresholds_only() ? run_threshold_kernel : run_kernel;
  run({constants_,
       static_cast<float>(dark_fa_),
       static_cast<float>(gain_fa_),
       static_cast<float>(noise_std_),
       seed_,
       noise_seed_,
       random_phase_,
       equal_thresholds_,
       threshold_on_.data(),
       threshold_off_.data(),
       light0_.data(),
       light1_.data(),
       m0_.data(),
       reference_.data(),
       blind_us_.data(),
       w_.data(),
       y_.data(),
       n_.data(),
       z_.data(),
       e_.data(),
       batch.planes,
       batch.first_frame,
       times ? batch.t_us[0] : 0,
       intervals,
       batch.last,
       range.first,
       range.size(),
       noise,
       exposures,
       &events,
       marks_.empty() ? nullptr : marks_.data()});
}

// Poisson processes of one rate in all pixels are one process of the summed rate with a random pixel per event. Drawn
// for fixed blocks of pixels and fixed windows of time, so that the events do not depend on tiles or batches.
std::vector<BackgroundEvent> PecsPixels::background(double begin_us, double end_us, PixelRange range) const {
  const auto [first, end] = range;
  std::vector<BackgroundEvent> events;
  const double rate_hz = background_on_hz_ + background_off_hz_;
  const auto first_window = static_cast<std::int64_t>(std::floor(begin_us / kBackgroundWindow_us));
  for (std::uint32_t block = first / kBlock; block * kBlock < end; ++block)
    for (std::int64_t window = first_window; static_cast<double>(window) * kBackgroundWindow_us < end_us; ++window) {
      std::int64_t draw = 0;
      Random4 r{};
      const auto next = [&] {
        if (draw % 4 == 0) r = random4(noise_seed_, block, window << 24 | draw / 4, Purpose::background);
        return uniform(r[static_cast<std::size_t>(draw++ % 4)]);
      };
      const int n = poisson(rate_hz * kBlock * kBackgroundWindow_us * 1e-6, next);
      for (int i = 0; i < n; ++i) {
        const double t_us = (static_cast<double>(window) + next()) * kBackgroundWindow_us;
        const auto pixel = block * kBlock + static_cast<std::uint32_t>(next() * kBlock);
        const bool on = next() * rate_hz < background_on_hz_;
        if (t_us >= begin_us && t_us < end_us && pixel >= first && pixel < end && !(maps_background() && mapped(pixel)))
          events.push_back({t_us, pixel, on});
      }
    }
  const auto of_one = [&](std::uint32_t pixel, double on_hz, double off_hz, Purpose purpose, Cause cause) {
    for (std::int64_t window = first_window; static_cast<double>(window) * kBackgroundWindow_us < end_us; ++window) {
      std::int64_t draw = 0;
      const auto next = [&] { return uniform(random4(noise_seed_, pixel, window << 24 | draw++, purpose)[0]); };
      const int n = poisson((on_hz + off_hz) * kBackgroundWindow_us * 1e-6, next);
      for (int i = 0; i < n; ++i) {
        const double t_us = (static_cast<double>(window) + next()) * kBackgroundWindow_us;
        const bool on = off_hz == 0 || next() * (on_hz + off_hz) < on_hz;
        if (t_us >= begin_us && t_us < end_us) events.push_back({t_us, pixel, on, cause});
      }
    }
  };
  for (std::uint32_t pixel = first; maps_background() && pixel < end; ++pixel)
    if (const auto i = mapped(pixel))
      of_one(pixel, map_->background_on_hz[*i], map_->background_off_hz[*i], Purpose::background, Cause::noise);
  for (auto hot = std::ranges::lower_bound(hot_, first, {}, &HotPixel::pixel); hot != hot_.end() && hot->pixel < end;
       ++hot)
    of_one(hot->pixel, hot->hz, 0, Purpose::hot, Cause::hot);
  std::ranges::stable_sort(events, {}, &BackgroundEvent::pixel);
  return events;
}

extern const ModelEntry kModel_pecs{"pecs",
                                    "docs/reference/sensor.md",
                                    {},
                                    {.takes_light = true, .tells_causes = true, .takes_noise_seed = true},
                                    make_model<PecsPixels>};

}  // namespace pecs::sensor
