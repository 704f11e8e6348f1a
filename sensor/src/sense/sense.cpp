#include "pecs/sensor/sense.h"

#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <functional>
#include <map>
#include <numbers>

#include "pecs/error.h"
#include "pecs/progress.h"
#include "pecs/sensor/sensor.h"
#include "pecs/sensor/stack.h"
#include "sense/chip_frames.h"
#include "sense/event_sink.h"
#include "sense/feed.h"
#include "sense/noise_estimate.h"
#include "sense/warm_up.h"

namespace pecs::sensor {
namespace {

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
  check_effect(options.light, source.info().quantity);
  if (options.model.white_fa > 0 && model_traits(options.model).takes_light)
    throw bad_usage("--white", "model " + options.model.name, "a model that takes pictures");
  if (options.frames && options.frames == options.output &&
      !events::codec_for_output(options.output, options.format).holds_frames)
    throw bad_usage("--frames", options.output.string(), "a new folder, or an output in AEDAT4, which holds frames");
  if (!options.motion && !source.has_motion())
    throw bad_usage("--no-motion", "no layer motion", "a stack that has one");
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
  const std::string remedy = source->options_for(static_cast<int>(chip.width), static_cast<int>(chip.height));
  check_fits(chip, info.width, info.height, name, remedy.empty() ? "" : fmt::format(" ({})", remedy));
  reject_unused(options, *source);
  model_to_json(options.model);  // throws for an unknown model or parameter
  return source;
}

// White of the models that take pictures: the first frame's 99.5 %.
double white_fa(const FrameSource& source, const Response& response) {
  const StackInfo& info = source.info();
  std::vector<float> first(static_cast<std::size_t>(info.width) * static_cast<std::size_t>(info.height));
  PhotocurrentReader(source, response).read(0, 0, info.height, first.data());
  const double white = quantile(std::move(first), 0.995);
  if (!(white > 0)) throw bad_input(source.name(), "first frame", "no light", "--white");
  return white;
}

// One run, from light to events: simulate() is the pipeline.
class SenseRun {
 public:
  explicit SenseRun(const SenseOptions& options);
  SenseReport run();

 private:
  Response response();
  ModelChoice model() const;
  Simulation simulation(std::optional<std::uint64_t> noise_seed = {}) const;
  void estimate_noise();
  void run_streaming();
  bool simulate(const LightBatch& light);
  void take_frames(const LightBatch& light, Region rows, FrameBatch& batch);
  void label_unsure();
  void run_loop_in_bands(std::span<const Region> bands);
  PixelRange pixels_of(Region rows) const;
  PixelRange all_pixels() const { return pixels_of({0, source_->info().height}); }
  void note_light(const LightBatch& light, PixelRange range);
  Json config() const;
  Json light_report();
  void warn_of_light(std::vector<std::string>& warnings) const;
  void warn_of_pitch(std::vector<std::string>& warnings) const;

  const SenseOptions& options_;
  Json results_;
  Chip chip_;
  std::shared_ptr<FrameSource> source_;
  Timeline timeline_;
  Response response_;
  ModelChoice model_;
  bool moves_;  // light between frames is warped along the source's motion
  PhotocurrentReader light_;
  FrameClock clock_;
  Simulation simulation_;
  std::optional<ChipFrames> frames_;
  std::optional<NoiseEstimate> noise_;
  LabelledEvents events_;
  bool changes_ = false;  // the light of a pixel, by a threshold since the first frame
  std::map<std::int64_t, std::vector<std::uint8_t>> unsure_;  // pixels, by step
  EventSink sink_;
  std::vector<float> first_fa_;    // light of the first frame
  std::int64_t light_planes_ = 0;  // given to the pixels
};

SenseRun::SenseRun(const SenseOptions& options)
    : options_(options),
      chip_(chip_of(options, options.frames.has_value(), "--frames")),
      source_(checked_source(options, chip_)),
      timeline_(*source_, options.window),
      response_(response()),
      model_(model()),
      moves_(options.motion && source_->has_motion()),
      light_(*source_, response_),
      simulation_(simulation()),
      sink_(options, chip_, timeline_) {
  if (moves_ && source_->info().has_noise && options_.render_noise > 0) estimate_noise();
  if (chip_.takes_frames)
    frames_.emplace(chip_, source_->info().width, source_->info().height, 1.0,
                    options_.no_noise ? std::nullopt : std::optional(options_.seed), timeline_.from_us(),
                    timeline_.to_us());
}

Simulation SenseRun::simulation(std::optional<std::uint64_t> noise_seed) const {
  const int width = source_->info().width;
  const bool labels = options_.labels || (source_->estimates_motion() && model_traits(model_).tells_causes);
  ModelChoice model = model_;
  model.noise_seed = noise_seed;
  return {{model, chip_, width, source_->info().height, options_.seed, 1.0, labels},
          EventSorter(width, labels, timeline_.read_out_from_us())};
}

void SenseRun::estimate_noise() {
  std::optional<Simulation> other_recording;
  if (model_traits(model_).takes_noise_seed) other_recording = simulation(~options_.seed);
  // The noise of two renders is in the difference of the lights.
  noise_.emplace(*source_, response_, std::numbers::sqrt2 * options_.render_noise, simulation(),
                 std::move(other_recording), Repeats(source_->info().width, timeline_.from_us(), timeline_.to_us()));
}

// Response to all bands, or to those drawn.
Response SenseRun::response() {
  const StackInfo& info = source_->info();
  const std::vector<double> all = amperes_per_unit(chip_, info, options_.light, source_->name());
  if (options_.monte_carlo_bands == 0) return {chip_, info, all, source_->name()};
  DrawnBands drawn = draw_bands(*source_, all, options_.monte_carlo_bands, options_.seed);
  results_["monte_carlo"] = {{"samples", options_.monte_carlo_bands},
                             {"bands", std::ranges::count_if(drawn.amperes, [](double a) { return a > 0; })},
                             {"of", all.size()},
                             {"rms_error_of_ln_photocurrent", drawn.rms_error_of_ln}};
  return {chip_, info, drawn.amperes, source_->name()};
}

ModelChoice SenseRun::model() const {
  ModelChoice model = options_.model;
  model.random_phase = options_.window.warmup_us > 0;
  if (!model_traits(model).takes_light && model.white_fa == 0) model.white_fa = white_fa(*source_, response_);
  return model;
}

SenseReport SenseRun::run() {
  std::vector<Region> bands;
  // An automatic exposure depends on all rows.
  if (!moves_) bands = timeline_.regions(simulation_.pixels.pixels_are_independent() && !chip_.has_auto_exposure());
  if (bands.size() > 1)
    run_loop_in_bands(bands);
  else
    run_streaming();
  sink_.close();

  results_.update(light_report());
  results_.update(sink_.report());
  std::vector<std::string> warnings = timeline_.warnings();
  warnings.insert(warnings.end(), chip_.warnings.begin(), chip_.warnings.end());
  constexpr double kClose_us = 20;
  if (const double step_us = timeline_.t_us(1) - timeline_.t_us(0);
      options_.times.file_us && !options_.times.unit && step_us < kClose_us)
    warnings.push_back(
        fmt::format("--times: frames are {:g} us apart; if the file is not in us, state --time-unit", step_us));
  if (const auto n = light_.not_finite(), m = light_.negative(); n + m > 0)
    warnings.push_back(fmt::format("{}: values that no light has: {} not finite, {} negative", source_->name(), n, m));
  if (const auto dropped = results_["dropped"].get<std::int64_t>())
    warnings.push_back(fmt::format("{}: {} events dropped by the readout", options_.output.string(), dropped));
  if (model_.name == "pecs") warn_of_light(warnings);
  if (model_traits(model_).takes_light) warn_of_pitch(warnings);
  results_.update({{"width", source_->info().width},
                   {"height", source_->info().height},
                   {"frames", source_->frames()},
                   {"warnings", warnings},
                   {"bad_values", {{"not_finite", light_.not_finite()}, {"negative", light_.negative()}}}});
  if (moves_) results_["dense_steps"] = light_planes_;
  if (noise_) noise_->report(results_);
  if (frames_) {
    results_["chip_frames"] = frames_->report();
    for (const std::string& warning : frames_->warnings()) results_["warnings"].push_back(warning);
  }
  const SourceReport frames = source_->report();
  if (frames.results.is_object()) results_.update(frames.results);
  for (const std::string& warning : frames.warnings) results_["warnings"].push_back(warning);
  if (moves_ && source_->estimates_motion()) {
    const auto unsure = sink_.unsure(), events = results_["events"].get<std::int64_t>();
    results_["unsure"] = {{"events", unsure},
                          {"share", events ? Json(static_cast<double>(unsure) / static_cast<double>(events)) : Json()}};
  }
  return {config(), results_};
}

void SenseRun::run_streaming() {
  ProgressReporter progress(options_, timeline_.steps());
  const auto step = [&](const LightBatch& light) {
    note_light(light, all_pixels());
    if (!simulate(light)) return false;
    progress.at(light.steps);
    return true;
  };
  WarmUp run(
      static_cast<double>(timeline_.warmup_us()), all_pixels().size(),
      [&](const LightBatch& light) { return simulate(light); }, step);
  if (moves_)
    feed_moving(timeline_, light_, noise_ ? &noise_->light() : nullptr, std::ref(run));
  else
    feed_frames(timeline_, light_, {0, source_->info().height}, std::ref(run));
}

// False: no further batches.
bool SenseRun::simulate(const LightBatch& light) {
  FrameBatch frames = clock_.batch(light.planes, light.t_us, light.last);
  if (frames_) take_frames(light, {0, source_->info().height}, frames);
  simulation_.step(frames, all_pixels(), clock_.final_us(), events_);
  if (noise_) noise_->step(frames, light.again, all_pixels(), clock_.final_us(), events_);
  if (moves_ && source_->estimates_motion()) label_unsure();
  return sink_.write(events_, frames.last);
}

// Takes the light's frames, and adds their exposures to the batch.
void SenseRun::take_frames(const LightBatch& light, Region rows, FrameBatch& batch) {
  frames_->add(light.planes, light.t_us, rows);
  batch.exposures = frames_->exposures(batch.t_us.front(), batch.t_us.back());
  sink_.write(frames_->take());
}

// Signal events of pixels whose light is a guess; of a model that reports no causes, all their events.
void SenseRun::label_unsure() {
  auto& [events, causes] = events_;
  causes.resize(events.size(), Cause::signal);
  const auto width = static_cast<std::size_t>(source_->info().width);
  std::int64_t step = unsure_.empty() ? 0 : unsure_.begin()->first;
  for (std::size_t i = 0; i < events.size(); ++i) {
    const events::Event& e = events[i];
    if (causes[i] != Cause::signal) continue;
    while (step + 2 < timeline_.steps() && timeline_.t_us(step + 1) <= static_cast<double>(e.t_us)) ++step;
    unsure_.erase(unsure_.begin(), unsure_.lower_bound(step));
    const auto [at, is_new] = unsure_.try_emplace(step);
    if (is_new) at->second = source_->unsure(timeline_.frame(step));
    const double begin_us = timeline_.t_us(step), length_us = timeline_.t_us(step + 1) - begin_us;
    const int eighth = std::clamp(static_cast<int>(8 * (static_cast<double>(e.t_us) - begin_us) / length_us), 0, 7);
    if (at->second[e.y * width + e.x] >> eighth & 1) causes[i] = Cause::unsure;
  }
}

// A loop whose frames do not fit into memory: band by band of rows, each through all loops. The events of a band wait
// for those of the others.
void SenseRun::run_loop_in_bands(std::span<const Region> bands) {
  const std::int64_t steps = timeline_.steps();
  ProgressReporter progress(options_, steps * std::ssize(bands));
  EventSorter& sorter = simulation_.sorter;
  sorter.begin_window(timeline_.read_out_from_us(), timeline_.to_us());
  for (std::size_t k = 0; k < bands.size(); ++k) {
    FrameClock clock;
    feed_frames(timeline_, light_, bands[k], [&](const LightBatch& light) {
      note_light(light, pixels_of(bands[k]));
      FrameBatch frames = clock.batch(light.planes, light.t_us, light.last);
      if (frames_) take_frames(light, bands[k], frames);
      simulation_.pixels.advance(frames, pixels_of(bands[k]), sorter);
      sorter.drop_outside();
      progress.at(static_cast<std::int64_t>(k) * steps + light.steps);
      return true;
    });
  }
  sorter.take_window([&](LabelledEvents& events, bool last) { sink_.write(events, last); });
}

PixelRange SenseRun::pixels_of(Region rows) const {
  const auto first_of = [&](int row) { return static_cast<std::uint32_t>(row * source_->info().width); };
  return {first_of(rows.begin), first_of(rows.end)};
}

// For the run record.
void SenseRun::note_light(const LightBatch& light, PixelRange range) {
  if (first_fa_.size() < all_pixels().size() && first_fa_.size() == range.first) {
    constexpr float kMost_fa = 1e15f;
    const std::span<const float> part(light.planes[0] + range.first, light.planes[0] + range.end);
    if (const auto most = std::ranges::find_if(part, [](float fa) { return fa >= kMost_fa; }); most != part.end())
      throw bad_input(source_->name(), "first frame", fmt::format("a photocurrent of {:.3g} A", 1e-15 * *most),
                      "less than 1 A: the unit of the light");
    first_fa_.insert(first_fa_.end(), part.begin(), part.end());
  }
  light_planes_ += std::ssize(light.planes);
  const double least = std::exp(std::min(chip_.contrast_threshold_on, chip_.contrast_threshold_off));
  for (std::size_t k = 0; k < light.planes.size() && !changes_; ++k)
    for (std::size_t i = range.first; i < range.end && !changes_; ++i) {
      const auto [low, high] = std::minmax(first_fa_[i], light.planes[k][i]);
      changes_ = high > least * low;
    }
}

void SenseRun::warn_of_light(std::vector<std::string>& warnings) const {
  // The time constant of the photoreceptor is as long as the recording, or a sixth of a second.
  const double end_us = std::min(static_cast<double>(timeline_.to_us()), timeline_.t_us(timeline_.steps() - 1));
  const double length_s = std::max(1.0, end_us - static_cast<double>(timeline_.from_us())) * 1e-6;
  const double dim_hz = std::max(1.0, 1 / (2 * std::numbers::pi * length_s));
  const double corner_hz = results_["corner_hz"]["median"].get<double>();
  const bool is_relative = source_->info().quantity == Quantity::relative;
  if (corner_hz > 0 && corner_hz < dim_hz)
    warnings.push_back(
        fmt::format("the photoreceptor's corner is {:.2g} Hz in the median pixel, which hardly follows in {:.3g} s: "
                    "more light gives more events ({})",
                    corner_hz, length_s, is_relative ? "--photocurrent" : "render with --light-scale 100"));
  if (!changes_) warnings.push_back("no pixel's light changes by a threshold: events, if any, are the chip's noise");
}

// A crop has the chip's pitch, a render of another resolution its film.
void SenseRun::warn_of_pitch(std::vector<std::string>& warnings) const {
  const StackInfo& info = source_->info();
  if (!info.pixel_pitch_m || (chip_.width == 0 && chip_.corner_hz_per_a == 0)) return;
  const auto differs = [](double a, double b) { return std::abs(a - b) > 0.02 * b; };
  const double pitch_m = *info.pixel_pitch_m;
  if (differs(pitch_m, chip_.pixel_pitch_m) && differs(pitch_m * info.width, chip_.pixel_pitch_m * chip_.width))
    warnings.push_back(fmt::format(
        "{}: its pixels are {:.4g} um apart, those of {} {:.4g} um: each gets the light of a pixel of the chip, in a "
        "picture that the chip does not have; simulate with the chip that it was rendered for",
        source_->name(), pitch_m * 1e6, chip_.name, chip_.pixel_pitch_m * 1e6));
}

Json SenseRun::light_report() {
  Json out;
  for (const auto& [name, part] : {std::pair{"p05", 0.05}, {"median", 0.5}, {"p95", 0.95}}) {
    const double a = 1e-15 * quantile(first_fa_, part);
    out["photocurrent_a"][name] = a;
    out["corner_hz"][name] = chip_.corner_hz_per_a * (a + chip_.dark_current_a);
  }
  return out;
}

Json SenseRun::config() const {
  const PhotocurrentOptions& light = options_.light;
  const bool has_white = source_->info().quantity == Quantity::relative && !light.gain;
  return {{"chip", chip_to_json(chip_)},
          {"preset", options_.preset.empty() ? Json() : Json(options_.preset)},
          {"model", model_to_json(model_)},
          {"readout", options_.ideal_readout ? "ideal" : "chip"},
          {"stages", stages_to_json(options_.stages)},
          {"input", source_->layout()},
          {"bands", options_.monte_carlo_bands ? fmt::format("mc:{}", options_.monte_carlo_bands) : "all"},
          {"gain", or_null(light.gain)},
          {"white_photocurrent_a", has_white ? Json(light.photocurrent_a.value_or(kDefaultWhite_a)) : Json()},
          {"seed", options_.seed},
          {"no_noise", options_.no_noise},
          {"warmup_loops", options_.window.warmup_loops},
          {"warmup_us", options_.window.warmup_us},
          {"start_us", options_.window.start_us},
          {"duration_us", or_null(options_.window.duration_us)},
          {"fnumber", or_null(light.gain      ? std::nullopt
                              : light.fnumber ? light.fnumber
                                              : source_->info().fnumber)},
          {"fps", or_null(options_.times.fps)},
          {"motion", moves_},
          {"render_noise", noise_ ? options_.render_noise : 0}};
}

}  // namespace

std::vector<std::filesystem::path> outputs_of(const SenseOptions& options) {
  const auto& frames = options.frames == options.output ? std::nullopt : options.frames;
  return {options.output, options.labels.value_or(""), options.dropped.value_or(""), frames.value_or("")};
}

Chip chip_of(const SenseOptions& options, bool takes_frames, const std::string& frames_option) {
  BiasSettings biases = options.biases;
  std::vector<std::string> ignored;
  if (options.bias_file)
    for (const auto& [name, offset] : read_bias_file(*options.bias_file, ignored)) biases.insert({name, offset});
  Chip chip = load_chip(options.chip, options.overrides, biases);
  for (const std::string& part : ignored)
    chip.warnings.push_back(
        fmt::format("{}: {} is enabled and not read; give its option", options.bias_file->string(), part));
  take_frames(chip, takes_frames, frames_option, options.overrides);
  if (!options.no_noise) return chip;
  const Chip quiet = without_noise(chip);
  const Json with = chip_to_json(chip)["values"], without = chip_to_json(quiet)["values"];
  for (const std::string& text : options.overrides)
    if (const std::string key = text.substr(0, text.find('=')); with.value(key, Json()) != without.value(key, Json()))
      throw bad_usage("--no-noise", fmt::format("--set {} as well", text), "one of them");
  return quiet;
}

SenseReport sense(const SenseOptions& options) {
  std::optional<tbb::global_control> limit;
  if (options.threads > 0)
    limit.emplace(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(options.threads));
  tbb::task_arena arena(options.threads > 0 ? options.threads : tbb::task_arena::automatic);
  return arena.execute([&] { return SenseRun(options).run(); });
}

}  // namespace pecs::sensor
