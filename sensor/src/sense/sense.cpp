#include "pecs/sensor/sense.h"

#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "light/feed.h"
#include "pecs/error.h"
#include "pecs/progress.h"
#include "pecs/sensor/sensor.h"
#include "pecs/sensor/stack.h"
#include "sense/event_sink.h"
#include "sense/repeats.h"

namespace pecs::sensor {
namespace {

constexpr double kMuchRenderNoise = 0.1;  // share of the events; more is a warning
constexpr double kWarmupStep_us = 500;    // between planes of the warm-up

// Reports progress to the terminal and to `options.progress`.
class ProgressReporter {
 public:
  ProgressReporter(const SenseOptions& options, std::int64_t steps)
      : options_(options), total_(static_cast<std::uint64_t>(steps)), progress_("sense", total_, options.quiet) {}
  void at(std::int64_t step) {
    progress_.at(static_cast<std::uint64_t>(step));
    if (options_.progress && !options_.progress(static_cast<double>(step) / static_cast<double>(total_)))
      throw Error(ExitCode::interrupted, "sense: stopped");
  }

 private:
  const SenseOptions& options_;
  std::uint64_t total_;
  Progress progress_;
};

// Rejects options that have no effect on this input.
void reject_unused(const SenseOptions& options, const FrameSource& source) {
  const PhotocurrentOptions& light = options.light;
  const std::string quantity = fmt::format("light in {} units", name_of(source.info().quantity));
  const auto reject = [](const char* option, const std::string& got, const char* wanted) {
    throw Error(ExitCode::usage, fmt::format("{}: got {}, wanted {}", option, got, wanted));
  };
  if (light.gain && light.fnumber) reject("--fnumber", "--gain beside it", "one of them");
  if (light.gain && light.photocurrent_a) reject("--photocurrent", "--gain beside it", "one of them");
  if (light.fnumber && source.info().quantity != Quantity::radiance) reject("--fnumber", quantity, "radiance");
  if (light.photocurrent_a && source.info().quantity != Quantity::relative)
    reject("--photocurrent", quantity, "relative light, or --gain");
  if (options.model.white_fa > 0 && model_traits(options.model.name).takes_light)
    reject("--white", "model " + options.model.name, "a model that takes pictures");
  if (!options.motion && !source.has_motion()) reject("--no-motion", "no layer motion", "a stack that has one");
}

// The source of a run, checked with all that was asked for before any work begins.
std::shared_ptr<FrameSource> checked_source(const SenseOptions& options, const Chip& chip) {
  std::shared_ptr<FrameSource> source =
      options.source ? options.source : std::make_shared<StackReader>(options.stack, options.times);
  const StackInfo& info = source->info();
  const std::string name = source->name();
  if (source->frames() < std::ssize(info.times_ns))
    throw bad_input(name, "frames", fmt::format("{} so far", source->frames()),
                    fmt::format("the {} of times_ns", info.times_ns.size()));
  if (source->frames() < 2) throw bad_input(name, "frames", "1", "at least 2");
  check_fits(chip, info.width, info.height, name);
  reject_unused(options, *source);
  model_to_json(options.model);  // throws for an unknown model or parameter
  return source;
}

// White of the models that take pictures: the first frame's 99.5 %.
double white_fa(const FrameSource& source, const std::vector<double>& amperes) {
  const StackInfo& info = source.info();
  std::vector<float> first(static_cast<std::size_t>(info.width) * static_cast<std::size_t>(info.height));
  PhotocurrentReader(source, amperes).read(0, 0, info.height, first.data());
  const double white = quantile_fa(first, 0.995);
  if (!(white > 0)) throw bad_input(source.name(), "first frame", "no light", "--white");
  return white;
}

// The first plane, until the second is known.
class HeldPlane {
 public:
  HeldPlane(const LightBatch& light, std::size_t pixels) : t_us_(light.t_us[0]), steps_(light.steps) {
    planes_.emplace_back(light.planes[0], light.planes[0] + pixels);
    if (!light.again.empty()) planes_.emplace_back(light.again[0], light.again[0] + pixels);
  }
  LightBatch batch() const {
    LightBatch batch{{planes_[0].data()}, {t_us_}, steps_, false};
    if (planes_.size() > 1) batch.again.push_back(planes_[1].data());
    return batch;
  }

 private:
  double t_us_;
  std::int64_t steps_;
  std::vector<std::vector<float>> planes_;
};

// One run, from light to events: the verbs of step() in their order are the pipeline.
class SenseRun {
 public:
  explicit SenseRun(const SenseOptions& options);
  SenseReport run();

 private:
  std::vector<double> amperes();
  ModelChoice model() const;
  PixelArray pixels(std::optional<std::uint64_t> noise_seed = {}) const;
  EventSorter sorter() const;
  void run_streaming();
  bool warm_up(const LightBatch& first, const LightBatch& second,
               const std::function<bool(const LightBatch&)>& advance) const;
  void run_loop_in_bands(std::span<const Region> bands);
  PixelRange pixels_of(Region rows) const;
  void note_light(const LightBatch& light, PixelRange range);
  Json config() const;
  Json light_report();

  const SenseOptions& options_;
  Json results_;
  Chip chip_;
  std::shared_ptr<FrameSource> source_;
  Timeline timeline_;
  std::vector<double> amperes_;
  ModelChoice model_;
  bool moves_;  // light between frames is warped along the source's motion
  PhotocurrentReader light_;
  PixelArray pixels_;
  EventSorter sorter_;
  EventSink sink_;
  // Another simulation, whose events are compared with those of the output.
  struct Again {
    Again(const SenseRun& run, std::optional<std::uint64_t> noise_seed)
        : pixels(run.pixels(noise_seed)),
          sorter(run.sorter()),
          repeats(run.source_->info().width, run.timeline_.from_us(), run.timeline_.to_us()) {}
    PixelArray pixels;
    EventSorter sorter;
    Repeats repeats;
    LabelledEvents events{};
  };
  // The same recording of another render, and another recording of the same light.
  struct Repetitions {
    // The noise of two renders is in the difference of the lights.
    explicit Repetitions(const SenseRun& run)
        : light(*run.source_, run.amperes_, std::numbers::sqrt2 * run.options_.render_noise), other_render(run, {}) {
      if (model_traits(run.model_.name).takes_noise_seed) other_recording.emplace(run, ~run.options_.seed);
    }
    PhotocurrentReader light;
    Again other_render;
    std::optional<Again> other_recording;
  };
  std::unique_ptr<Repetitions> again_;
  std::vector<float> first_fa_;    // light of the first frame
  std::int64_t light_planes_ = 0;  // given to the pixels
};

SenseRun::SenseRun(const SenseOptions& options)
    : options_(options),
      chip_(chip_of(options)),
      source_(checked_source(options, chip_)),
      timeline_(*source_, options.window),
      amperes_(amperes()),
      model_(model()),
      moves_(options.motion && source_->has_motion()),
      light_(*source_, amperes_),
      pixels_(pixels()),
      sorter_(sorter()),
      sink_(options, chip_, timeline_) {
  if (moves_ && source_->info().has_noise && options_.render_noise > 0) again_ = std::make_unique<Repetitions>(*this);
}

PixelArray SenseRun::pixels(std::optional<std::uint64_t> noise_seed) const {
  const StackInfo& info = source_->info();
  ModelChoice model = model_;
  model.noise_seed = noise_seed;
  return {model, chip_, info.width, info.height, options_.seed, 1.0, options_.labels.has_value()};
}

EventSorter SenseRun::sorter() const {
  // The readout begins after the warm-up.
  const std::int64_t from_us = timeline_.warms_up() ? timeline_.from_us() : 0;
  return EventSorter(source_->info().width, options_.labels.has_value(), from_us);
}

// Per unit of each band's value: of all bands, or of those drawn.
std::vector<double> SenseRun::amperes() {
  std::vector<double> all = amperes_per_unit(chip_, source_->info(), options_.light, source_->name());
  if (options_.monte_carlo_bands == 0) return all;
  DrawnBands drawn = draw_bands(*source_, all, options_.monte_carlo_bands, options_.seed);
  results_["monte_carlo"] = {{"samples", options_.monte_carlo_bands},
                             {"bands", std::ranges::count_if(drawn.amperes, [](double a) { return a > 0; })},
                             {"of", all.size()},
                             {"rms_error_of_ln_photocurrent", drawn.rms_error_of_ln}};
  return std::move(drawn.amperes);
}

ModelChoice SenseRun::model() const {
  ModelChoice model = options_.model;
  model.random_phase = options_.window.warmup_us > 0;
  if (!model_traits(model.name).takes_light && model.white_fa == 0) model.white_fa = white_fa(*source_, amperes_);
  return model;
}

SenseReport SenseRun::run() {
  std::vector<Region> bands;
  if (!moves_) bands = timeline_.regions(pixels_.pixels_are_independent());
  if (bands.size() > 1)
    run_loop_in_bands(bands);
  else
    run_streaming();
  sink_.close();

  results_.update(light_report());
  results_.update(sink_.report());
  std::vector<std::string> warnings = timeline_.warnings();
  warnings.insert(warnings.end(), chip_.warnings.begin(), chip_.warnings.end());
  results_.update({{"width", source_->info().width},
                   {"height", source_->info().height},
                   {"frames", source_->frames()},
                   {"warnings", warnings},
                   {"bad_values", {{"not_finite", light_.not_finite()}, {"negative", light_.negative()}}}});
  if (moves_) results_["dense_steps"] = light_planes_;
  if (again_) {
    results_["render_noise"] = again_->other_render.repeats.report();
    std::string camera;
    if (again_->other_recording) {
      const Repeats& repeats = again_->other_recording->repeats;
      results_["camera_noise"] = repeats.report();
      camera = fmt::format("; from the camera's own noise: {:.0f} %", 100 * repeats.share());
    }
    if (const double share = again_->other_render.repeats.share(); share > kMuchRenderNoise)
      results_["warnings"].push_back(fmt::format(
          "{:.0f} % of the events come from the noise of the renderer (they would not come again in another render{}); "
          "render with more --samples, or with --noise-events 10%",
          100 * share, camera));
  }
  return {config(), results_};
}

void SenseRun::run_streaming() {
  const Region all{0, source_->info().height};
  ProgressReporter progress(options_, timeline_.steps());
  FrameClock clock;
  LabelledEvents events;
  const auto advance = [&](const LightBatch& light) {
    FrameBatch frames = clock.batch(light.planes, light.t_us, light.last);
    const auto simulate = [&](PixelArray& pixels, EventSorter& sorter, LabelledEvents& out) {
      sorter.begin(frames.t_us);
      pixels.advance(frames, pixels_of(all), sorter);
      sorter.take(clock.final_us(), out);
    };
    simulate(pixels_, sorter_, events);
    if (again_) {
      const auto repeat = [&](Again& other, LabelledEvents& first) {
        simulate(other.pixels, other.sorter, other.events);
        other.repeats.match(first, other.events, clock.final_us(), frames.last);
      };
      if (again_->other_recording) {
        LabelledEvents same = events;
        repeat(*again_->other_recording, same);
      }
      frames.planes = light.again;
      repeat(again_->other_render, events);
    }
    return sink_.write(events, frames.last);
  };
  const auto step = [&](const LightBatch& light) {
    note_light(light, pixels_of(all));
    if (!advance(light)) return false;
    progress.at(light.steps);
    return true;
  };
  // A batch holds one plane at least, and the warm-up needs the light's direction at the start: two planes.
  std::optional<HeldPlane> start;
  const auto step_after_warmup = [&](const LightBatch& light) {
    if (timeline_.warmup_us() == 0 || clock.frames() > 0) return step(light);
    if (!start && light.planes.size() == 1 && !light.last) {
      start.emplace(light, pixels_of(all).size());
      return true;
    }
    const LightBatch first = start ? start->batch() : light;
    return warm_up(first, start ? light : first, advance) && (!start || step(first)) && step(light);
  };
  if (moves_)
    feed_moving(timeline_, light_, again_ ? &again_->light : nullptr, step_after_warmup);
  else
    feed_frames(timeline_, light_, all, step_after_warmup);
}

// Light before the first frame: it has changed as it does from there to the second plane, by at most kMostChange.
// Pixels take the direction from the first two planes, so these differ wherever the light will change. second: the
// batch that holds the second plane: `first`, or the one after it. False: no further batches.
bool SenseRun::warm_up(const LightBatch& first, const LightBatch& second,
                       const std::function<bool(const LightBatch&)>& advance) const {
  constexpr float kMostChange = 0.5f, kTouch = 1e-4f;  // of ln I
  constexpr std::size_t kPlanes = 16;                  // of a batch
  const std::size_t pixels = pixels_of({0, source_->info().height}).size();
  const auto length_us = static_cast<double>(timeline_.warmup_us());
  const auto count = static_cast<std::size_t>(std::ceil(length_us / kWarmupStep_us));
  const std::size_t chips = first.again.empty() ? 1 : 2, at = &second == &first ? 1 : 0;
  const auto light_of = [](const LightBatch& batch, std::size_t chip) -> const std::vector<const float*>& {
    return chip == 0 ? batch.planes : batch.again;
  };
  std::vector<std::vector<float>> per_us(chips, std::vector<float>(pixels));
  for (std::size_t chip = 0; chip < chips && at < second.planes.size(); ++chip)
    for (std::size_t i = 0; i < pixels; ++i) {
      const float change = std::log(light_of(second, chip)[at][i] / light_of(first, chip)[0][i]);
      per_us[chip][i] = std::isfinite(change) ? change / static_cast<float>(second.t_us[at] - first.t_us[0]) : 0;
    }
  std::vector<std::vector<float>> planes(kPlanes * chips, std::vector<float>(pixels));
  for (std::size_t begin = 0; begin < count; begin += kPlanes) {
    LightBatch batch;
    const std::size_t size = std::min(kPlanes, count - begin);
    for (std::size_t k = 0; k < size; ++k) {
      batch.planes.push_back(planes[chips * k].data());
      if (chips > 1) batch.again.push_back(planes[chips * k + 1].data());
      batch.t_us.push_back(length_us * static_cast<double>(begin + k) / static_cast<double>(count));
    }
    tbb::parallel_for(std::size_t{0}, size * chips, [&](std::size_t of) {
      const std::size_t k = of / chips, chip = of % chips;
      const auto before_us = static_cast<float>(length_us - batch.t_us[k]);
      for (std::size_t i = 0; i < pixels; ++i) {
        const float slope = per_us[chip][i];
        float change = std::clamp(slope * before_us, -kMostChange, kMostChange);
        if (begin + k == 0) change += slope > 0 ? kTouch : slope < 0 ? -kTouch : 0;
        planes[of][i] = light_of(first, chip)[0][i] * (change == 0 ? 1 : std::exp(-change));
      }
    });
    if (!advance(batch)) return false;
  }
  return true;
}

// A loop whose frames do not fit into memory: band by band of rows, each through all loops. The events of a band wait
// for those of the others.
void SenseRun::run_loop_in_bands(std::span<const Region> bands) {
  const std::int64_t steps = timeline_.steps();
  ProgressReporter progress(options_, steps * std::ssize(bands));
  sorter_.begin_window(timeline_.from_us(), timeline_.to_us());
  for (std::size_t k = 0; k < bands.size(); ++k) {
    FrameClock clock;
    feed_frames(timeline_, light_, bands[k], [&](const LightBatch& light) {
      note_light(light, pixels_of(bands[k]));
      pixels_.advance(clock.batch(light.planes, light.t_us, light.last), pixels_of(bands[k]), sorter_);
      sorter_.drop_outside();
      progress.at(static_cast<std::int64_t>(k) * steps + light.steps);
      return true;
    });
  }
  sorter_.take_window([&](LabelledEvents& events, bool last) { sink_.write(events, last); });
}

PixelRange SenseRun::pixels_of(Region rows) const {
  const auto first_of = [&](int row) { return static_cast<std::uint32_t>(row * source_->info().width); };
  return {first_of(rows.begin), first_of(rows.end)};
}

// For the run record.
void SenseRun::note_light(const LightBatch& light, PixelRange range) {
  const std::size_t pixels = pixels_of({0, source_->info().height}).size();
  if (!light.planes.empty() && first_fa_.size() < pixels && first_fa_.size() == range.first)
    first_fa_.insert(first_fa_.end(), light.planes[0] + range.first, light.planes[0] + range.end);
  light_planes_ += std::ssize(light.planes);
}

Json SenseRun::light_report() {
  Json out;
  for (const auto& [name, part] : {std::pair{"p05", 0.05}, {"median", 0.5}, {"p95", 0.95}}) {
    const double a = 1e-15 * quantile_fa(first_fa_, part);
    out["photocurrent_a"][name] = a;
    out["corner_hz"][name] = chip_.corner_hz_per_a * (a + chip_.dark_current_a);
  }
  return out;
}

Json SenseRun::config() const {
  const auto optional = [](const auto& value) { return value ? Json(*value) : Json(); };
  const PhotocurrentOptions& light = options_.light;
  const bool has_white = source_->info().quantity == Quantity::relative && !light.gain;
  return {{"chip", chip_to_json(chip_)},
          {"preset", options_.preset.empty() ? Json() : Json(options_.preset)},
          {"model", model_to_json(model_)},
          {"readout", options_.ideal_readout ? "ideal" : "chip"},
          {"stages", stages_to_json(options_.stages)},
          {"input", source_->layout()},
          {"bands", options_.monte_carlo_bands ? fmt::format("mc:{}", options_.monte_carlo_bands) : "all"},
          {"gain", optional(light.gain)},
          {"white_photocurrent_a", has_white ? Json(light.photocurrent_a.value_or(kDefaultWhite_a)) : Json()},
          {"seed", options_.seed},
          {"no_noise", options_.no_noise},
          {"warmup_loops", options_.window.warmup_loops},
          {"warmup_us", options_.window.warmup_us},
          {"start_us", options_.window.start_us},
          {"duration_us", optional(options_.window.duration_us)},
          {"fnumber", optional(light.gain      ? std::nullopt
                               : light.fnumber ? light.fnumber
                                               : source_->info().fnumber)},
          {"fps", optional(options_.times.fps)},
          {"motion", moves_},
          {"render_noise", again_ ? options_.render_noise : 0}};
}

}  // namespace

Chip chip_of(const SenseOptions& options) {
  BiasSettings biases = options.biases;
  std::vector<std::string> ignored;
  if (options.bias_file)
    for (const auto& [name, offset] : read_bias_file(*options.bias_file, ignored)) biases.insert({name, offset});
  Chip chip = load_chip(options.chip, options.overrides, biases);
  for (const std::string& part : ignored)
    chip.warnings.push_back(
        fmt::format("{}: {} is enabled and not read; give its option", options.bias_file->string(), part));
  return options.no_noise ? without_noise(chip) : chip;
}

SenseReport sense(const SenseOptions& options) {
  std::optional<tbb::global_control> limit;
  if (options.threads > 0)
    limit.emplace(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(options.threads));
  tbb::task_arena arena(options.threads > 0 ? options.threads : tbb::task_arena::automatic);
  return arena.execute([&] { return SenseRun(options).run(); });
}

}  // namespace pecs::sensor
