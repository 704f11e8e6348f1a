#include "pecs/sensor/sense.h"

#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>

#include "dense_feed.h"
#include "event_sink.h"
#include "light_feed.h"
#include "pecs/error.h"
#include "pecs/progress.h"
#include "pecs/sensor/sensor.h"
#include "pecs/sensor/stack.h"

namespace pecs::sensor {
namespace {

// Work that is done, to the terminal and to the caller.
class Told {
 public:
  Told(const SenseOptions& options, std::uint64_t total)
      : options_(options), total_(total), progress_("sense", total, options.quiet || total == 0) {}
  void at(std::uint64_t done) {
    if (total_ == 0) return;  // live
    progress_.at(done);
    if (options_.progress && !options_.progress(static_cast<double>(done) / static_cast<double>(total_)))
      throw Error(ExitCode::interrupted, "sense: stopped");
  }

 private:
  const SenseOptions& options_;
  std::uint64_t total_;
  Progress progress_;
};

// What the run tells of the light.
struct LightFound {
  std::vector<float> first_fa;  // of the first frame
  std::int64_t planes = 0;      // given to the pixels
};

// From light to events. `moves`: along the source's motion.
void run(const SenseOptions& options, const Chip& chip, const ModelChoice& model, const Timeline& timeline,
         PhotocurrentReader& light, EventSink& sink, bool moves, LightFound& found) {
  const StackInfo& info = light.info();
  const bool causes = options.labels.has_value();
  PixelArray pixels(model, chip, info.width, info.height, options.seed, 1.0, causes);
  EventSorter sorter(info.width, causes, timeline.loops() ? timeline.from_us() : 0);  // the warm-up is not read out
  LabelledEvents events;

  const std::vector<Region> regions =
      moves ? std::vector<Region>{{0, info.height}} : timeline.regions(pixels.pixels_are_independent());
  const bool held = regions.size() > 1;  // the events of a region wait for those of the others
  if (held) sorter.begin_window(timeline.from_us(), timeline.to_us());
  const auto steps = static_cast<std::uint64_t>(timeline.steps().value_or(0));
  Told told(options, steps * regions.size());
  for (std::size_t k = 0; k < regions.size(); ++k) {
    const auto pixel_at = [&](int row) { return static_cast<std::uint32_t>(row * info.width); };
    const PixelRange range{pixel_at(regions[k].begin), pixel_at(regions[k].end)};
    const std::unique_ptr<Feed> feed = moves ? std::unique_ptr<Feed>(std::make_unique<DenseFeed>(timeline, light))
                                             : std::make_unique<LightFeed>(timeline, light, regions[k]);
    FrameClock clock;
    while (const auto planes = feed->next()) {
      if (clock.frames() == 0 && !planes->planes.empty())
        found.first_fa.insert(found.first_fa.end(), planes->planes[0] + range.first, planes->planes[0] + range.end);
      found.planes += std::ssize(planes->planes);
      const FrameBatch batch = clock.batch(planes->planes, planes->t_us, planes->last);
      if (!held) sorter.begin(batch.t_us);
      pixels.advance(batch, range, sorter);
      if (held) {
        sorter.drop_outside();
      } else {
        sorter.take(clock.final_us(), events);
        if (!sink.write(events, batch.last)) return;
      }
      told.at(k * steps + static_cast<std::uint64_t>(feed->steps()));
    }
  }
  if (held) sorter.take_window([&](LabelledEvents& some, bool last) { sink.write(some, last); });
}

void check(const FrameSource& source, const Chip& chip) {
  const StackInfo& info = source.info();
  const std::string name = source.name();
  if (!source.is_live() && source.frames() < std::ssize(info.times_ns))
    throw bad_input(name, "frames", fmt::format("{} so far", source.frames()),
                    fmt::format("the {} of times_ns", info.times_ns.size()));
  if (!source.is_live() && source.frames() < 2) throw bad_input(name, "frames", "1", "at least 2");
  check_fits(chip, info.width, info.height, name);
}

// No option is without effect and without a word.
void refuse_unused(const SenseOptions& options, const FrameSource& source) {
  const PhotocurrentOptions& light = options.light;
  const std::string quantity = fmt::format("light in {} units", name_of(source.info().quantity));
  const auto refuse = [](const char* option, const std::string& got, const char* wanted) {
    throw Error(ExitCode::usage, fmt::format("{}: got {}, wanted {}", option, got, wanted));
  };
  if (light.gain && light.fnumber) refuse("--fnumber", "--gain beside it", "one of them");
  if (light.gain && light.photocurrent_a) refuse("--photocurrent", "--gain beside it", "one of them");
  if (light.fnumber && source.info().quantity != Quantity::radiance) refuse("--fnumber", quantity, "radiance");
  if (light.photocurrent_a && source.info().quantity != Quantity::relative)
    refuse("--photocurrent", quantity, "relative light, or --gain");
  if (options.model.white_fa > 0 && model_traits(options.model.name).takes_light)
    refuse("--white", "model " + options.model.name, "a model that takes pictures");
  if (!options.motion && !source.has_motion()) refuse("--no-motion", "no layer motion", "a stack that has one");
}

// White for the models that take pictures: the first frame's 99.5 %.
double white_fa(const FrameSource& source, const std::vector<double>& amperes) {
  const StackInfo& info = source.info();
  std::vector<float> first(static_cast<std::size_t>(info.width) * static_cast<std::size_t>(info.height));
  PhotocurrentReader(source, amperes).read(0, 0, info.height, first.data());
  const double white = quantile_fa(first, 0.995);
  if (!(white > 0)) throw bad_input(source.name(), "first frame", "no light", "--white");
  return white;
}

Json light_report(std::vector<float>& first_light, const Chip& chip) {
  Json out;
  for (const auto& [name, part] : {std::pair{"p05", 0.05}, {"median", 0.5}, {"p95", 0.95}}) {
    const double a = 1e-15 * quantile_fa(first_light, part);
    out["photocurrent_a"][name] = a;
    out["corner_hz"][name] = chip.corner_hz_per_a * (a + chip.dark_current_a);
  }
  return out;
}

Json config_of(const SenseOptions& options, const Chip& chip, const ModelChoice& model, const FrameSource& source) {
  const auto optional = [](const auto& value) { return value ? Json(*value) : Json(); };
  const PhotocurrentOptions& light = options.light;
  const bool has_white = source.info().quantity == Quantity::relative && !light.gain;
  return {{"chip", chip_to_json(chip)},
          {"model", model_to_json(model)},
          {"readout", options.ideal_readout ? "ideal" : "chip"},
          {"input", source.layout()},
          {"bands", options.monte_carlo_bands ? fmt::format("mc:{}", options.monte_carlo_bands) : "all"},
          {"gain", optional(light.gain)},
          {"white_photocurrent_a", has_white ? Json(light.photocurrent_a.value_or(kDefaultWhite_a)) : Json()},
          {"seed", options.seed},
          {"no_noise", options.no_noise},
          {"warmup_loops", options.window.warmup_loops},
          {"start_us", options.window.start_us},
          {"duration_us", optional(options.window.duration_us)},
          {"fnumber", optional(light.gain      ? std::nullopt
                               : light.fnumber ? light.fnumber
                                               : source.info().fnumber)},
          {"fps", optional(options.times.fps)}};
}

}  // namespace

SenseReport sense(const SenseOptions& options) {
  const Chip given = load_chip(options.chip, options.overrides);
  const Chip chip = options.no_noise ? without_noise(given) : given;
  const std::shared_ptr<FrameSource> source =
      options.source ? options.source : std::make_shared<StackReader>(options.stack, options.times);
  check(*source, chip);
  ModelChoice model = options.model;
  refuse_unused(options, *source);
  model_to_json(model);  // a wrong model or parameter is refused before any work
  const Timeline timeline(*source, options.window);

  std::vector<double> amperes = amperes_per_unit(chip, source->info(), options.light);
  Json results;
  if (options.monte_carlo_bands > 0) {
    const DrawnBands drawn = draw_bands(*source, amperes, options.monte_carlo_bands, options.seed);
    amperes = drawn.amperes;
    results["monte_carlo"] = {{"samples", options.monte_carlo_bands},
                              {"bands", std::ranges::count_if(amperes, [](double a) { return a > 0; })},
                              {"of", amperes.size()},
                              {"rms_error_of_ln_photocurrent", drawn.rms_error_of_ln}};
  }
  if (!model_traits(model.name).takes_light && model.white_fa == 0) model.white_fa = white_fa(*source, amperes);

  PhotocurrentReader light(*source, amperes);
  EventSink sink(options, chip, timeline);
  const bool moves = options.motion && source->has_motion();
  LightFound found;
  std::optional<tbb::global_control> limit;
  if (options.threads > 0)
    limit.emplace(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(options.threads));
  tbb::task_arena arena(options.threads > 0 ? options.threads : tbb::task_arena::automatic);
  arena.execute([&] { run(options, chip, model, timeline, light, sink, moves, found); });
  sink.close();

  results.update(light_report(found.first_fa, chip));
  results.update(sink.report());
  results.update({{"width", source->info().width},
                  {"height", source->info().height},
                  {"frames", source->frames()},
                  {"warnings", timeline.warnings()},
                  {"bad_values", {{"not_finite", light.not_finite()}, {"negative", light.negative()}}}});
  if (moves) results["dense_steps"] = found.planes;
  Json config = config_of(options, chip, model, *source);
  config["motion"] = moves;
  return {config, results};
}

}  // namespace pecs::sensor
