// pecs sense: an EXR stack in, events out.
#include "pecs/sensor/sense.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "commands.h"
#include "console.h"
#include "help.h"
#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/input/pictures.h"
#include "pecs/input/screen.h"
#include "pecs/sensor/sense_options.h"
#include "pecs/text.h"
#include "read_arguments.h"
#include "stage_arguments.h"
#include "units.h"

namespace pecs::app {
namespace {

std::pair<std::string, double> key_value(const std::string& text, const std::string& option) {
  if (const auto equals = text.find('='); equals != std::string::npos)
    if (const auto value = number_from<double>(text.substr(equals + 1))) return {text.substr(0, equals), *value};
  throw bad_usage(option, text, "KEY=NUMBER");
}

struct SenseArguments : sensor::SenseOptions {
  bool json = false;
  std::vector<std::string> parameters, bias_texts;
  std::string readout = "chip", bands = "all";
  input::PictureOptions pictures;
  bool view = false;
  input::Screen screen;
  double white_a = 0;
  const CLI::Option* shown = nullptr;                              // valid only with --view
  const CLI::Option *own_model = nullptr, *own_readout = nullptr;  // instead of the preset's
};

void add_part(CLI::App* sub, input::PictureOptions& pictures) {
  const auto crop = [&pictures](const std::string& text) {
    const auto w = numbers_of<int>(text, ',', 4);
    if (!w || std::ranges::min(*w) < 0 || std::ranges::max(*w) > sensor::kMaxSide)
      throw CLI::ValidationError("--crop", fmt::format("got '{}', wanted X,Y,WIDTH,HEIGHT in pixels", text));
    pictures.crop = {(*w)[0], (*w)[1], (*w)[2], (*w)[3]};
  };
  sub->add_option_function<std::string>("--crop", crop, "part of pictures or video that is used, in their pixels")
      ->type_name("X,Y,WIDTH,HEIGHT");
  const auto size = [&pictures](const std::string& text) {
    const auto s = numbers_of<int>(text, 'x', 2);
    if (!s || std::ranges::min(*s) < 1 || std::ranges::max(*s) > sensor::kMaxSide)
      throw CLI::ValidationError(
          "--size", fmt::format("got '{}', wanted WIDTHxHEIGHT in pixels, each 1 to {}", text, sensor::kMaxSide));
    pictures.size = {(*s)[0], (*s)[1]};
  };
  sub->add_option_function<std::string>("--size", size, "resample pictures or video to this size, in linear light")
      ->type_name("WIDTHxHEIGHT");
}

void add_frames(CLI::App* sub, SenseArguments* o) {
  add_quantity(*sub, "--fps", o->times.fps, "Hz", "frame rate of frames without timestamps")->check(positive());
  sub->add_option("--times", o->times.file_us, "text file with the frames' timestamps, one per line");
  add_time_unit(*sub, o->times.unit, "unit of --times (default: us)");
  sub->add_option(
      "--colorspace", o->pictures.colour_space,
      "colour space of pictures and video: srgb (default for integers), linear (for floats), gamma:G (light is "
      "value^G), or one of the OCIO config");
  sub->add_option("--ocio", o->pictures.ocio_config, "OpenColorIO config (default: $OCIO)");
  add_quantity(*sub, "--photocurrent", o->light.photocurrent_a, "A", "photocurrent of relative light 1 (white)")
      ->check(positive());
  sub->add_option("--bands", o->bands, "all, or mc:N: N bands drawn by their share of the light (Eq. 8-11)")
      ->check(CLI::Validator(
          [](std::string& text) { return sensor::monte_carlo_bands(text) ? "" : "wanted all or mc:N"; }, "all|mc:N"))
      ->capture_default_str();
  add_part(sub, o->pictures);
  sub->add_flag("!--no-flow", o->pictures.flow,
                "do not estimate the motion between pictures or frames of a video by optical flow");
  add_quantity(*sub, "--rolling-shutter", o->pictures.rolling_shutter_us, "us",
               "pictures or video whose rows are exposed one after another: time from the first row to the last")
      ->check(positive());
  sub->add_flag("!--no-motion", o->motion, "do not interpolate between frames by the stack's layer motion");
  sub->add_option("--render-noise", o->render_noise,
                  "factor on the renderer's noise in the estimate of its events; 0: no estimate")
      ->check(CLI::Range(0.0, sensor::kMostRenderNoise))
      ->capture_default_str();
  sub->add_option("--fnumber", o->light.fnumber, "f-number of the lens, for a stack of radiance")->check(positive());
  sub->add_option("--gain", o->light.gain,
                  "relative light: photocurrent [A] per sum of wavelength_nm QE L weight_nm (Eq. 6's C)")
      ->check(positive());
}

void add_pixels(CLI::App* sub, SenseArguments* o) {
  sub->add_option("--chip", o->chip, "chip profile: a name or a .json path")->capture_default_str();
  sub->add_option("--set", o->overrides,
                  "KEY=VALUE: a value of the chip, a plain number in the profile's unit, such as "
                  "refractory_period_s=0.001 (once per key)")
      ->allow_extra_args(false);
  sub->add_option("--bias", o->bias_texts,
                  "NAME=OFFSET[,...]: biases as offsets to the factory setting, such as diff_on=35")
      ->allow_extra_args(false);
  sub->add_option("--bias-file", o->bias_file, "biases of a Metavision .bias file or camera settings (.json)");
  sub->add_flag("--no-noise", o->no_noise, "disable photon noise, leak, background events, hot pixels and mismatch");
  sub->add_option("--seed", o->seed, "seed of all random numbers")
      ->check(CLI::Range(std::uint64_t{0}, sensor::kLargestSeed))
      ->capture_default_str();
  sub->add_option("--threads", o->threads, "number of threads, 0: all; the events do not depend on it")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  sub->add_option("--preset", o->preset,
                  "published setting of another simulator: model, parameters and values of the chip (pecs presets)");
  o->own_model =
      sub->add_option("--model", o->model.name,
                      fmt::format("pixel model: {}, or FILE.py:NAME, Python that is run; all others but pecs "
                                  "are models of other simulators",
                                  fmt::join(sensor::model_names(), ", ")))
          ->capture_default_str();
  sub->add_option("--param", o->parameters, "KEY=VALUE: a parameter of the model, other than pecs (once per key)")
      ->allow_extra_args(false);
  add_quantity(*sub, "--white", o->white_a, "A",
               "photocurrent of white, for the other models (default: first frame's 99.5 %)")
      ->check(positive());
  o->own_readout =
      sub->add_option("--readout", o->readout, "chip (row arbiter, rate limit, time base) or ideal, as with --preset")
          ->check(CLI::IsMember({"chip", "ideal"}))
          ->capture_default_str();
  sub->add_option("--frames", o->frames,
                  "the chip also takes frames (davis346, davis240c): new folder of PNG with images.txt, or OUTPUT "
                  "itself, if it is AEDAT4")
      ->type_name("FOLDER");
  add_output(*sub, "--labels", o->labels,
             "NPY file of each event's cause: 0 signal, 1 leak, 2 noise, 3 hot pixel, 4 noise of "
             "the renderer, 5 unsure (no reliable motion between pictures), 6 frame (--frames)");
}

void add_window(CLI::App* sub, SenseArguments* o) {
  sub->add_option("--warmup-loops", o->window.warmup_loops,
                  "loops of a periodic stack to simulate before the output starts")
      ->check(CLI::Range(0, 1000000));
  add_quantity(*sub, "--warmup", o->window.warmup_us, "us",
               "light before the first frame, extrapolated, for pixels that have been on (random reference levels)")
      ->check(CLI::Range(std::int64_t{0}, sensor::kLongestWarmup_us));
  add_quantity(*sub, "--start", o->window.start_us, "us",
               "start of the output, from the first frame or the end of the warm-up")
      ->check(CLI::Range(std::int64_t{0}, sensor::kLongestTime_us));
  add_quantity(*sub, "--duration", o->window.duration_us, "us",
               "duration of the output; a periodic stack is looped (default: its period)")
      ->check(CLI::Range(std::int64_t{1}, sensor::kLongestTime_us));
}

void add_view(CLI::App* sub, SenseArguments* o) {
  sub->add_flag("--view", o->view, "show the events as they come, on screen or, without a display, in OUTPUT.mp4");
  o->shown = add_quantity(*sub, "--window", o->screen.picture_us, "us", "duration of the events in one picture")
                 ->check(CLI::Range(std::int64_t{1}, std::int64_t{1} << 40))
                 ->capture_default_str();
}

// Converts option texts to values; throws usage for conflicting options.
void resolve(SenseArguments& o, const Console& console) {
  o.quiet = console.quiet();
  o.ideal_readout = o.readout == "ideal";
  o.model.white_fa = o.white_a * 1e15;
  for (const std::string& text : o.parameters) {
    const auto [at, is_new] = o.model.parameters.insert(key_value(text, "--param"));
    if (!is_new) throw Error(ExitCode::usage, fmt::format("--param {}: {} is set twice; set it once", text, at->first));
  }
  if (!o.preset.empty()) sensor::apply_preset(o, o.own_model->count() > 0, o.own_readout->count() > 0);
  for (const std::string& text : o.bias_texts)
    for (const auto& bias : sensor::biases_from(text))
      if (!o.biases.insert(bias).second)
        throw Error(ExitCode::usage, fmt::format("--bias {}: {} is set twice; set it once", text, bias.first));
  o.monte_carlo_bands = sensor::monte_carlo_bands(o.bands).value_or(0);
  if (o.shown->count() && !o.view) throw Error(ExitCode::usage, "--window: valid only with --view");
}

// Files that are read.
std::vector<std::filesystem::path> inputs(const SenseArguments& o) {
  std::vector<std::filesystem::path> files = {o.stack};
  if (const auto file = python_file(o.model.name)) files.emplace_back(*file);
  return files;
}

sensor::SenseReport run(SenseArguments& o, const Console& console) {
  if (o.view) o.screen.video = o.output.string() + ".mp4";  // a further output
  std::vector<std::filesystem::path> outputs = sensor::outputs_of(o);
  outputs.push_back(o.screen.video);
  check_outputs(inputs(o), outputs);
  if (python_file(o.model.name)) o.model.user = python_model(o.model.name, console.verbose());
  o.pictures.times = o.times;
  o.source = input::open_frames(o.stack, o.pictures);
  return o.view ? input::sense_on_screen(o.screen, o) : sensor::sense(o);
}

void print(const SenseArguments& o, const sensor::SenseReport& report, const Console& console) {
  const Json& r = report.results;
  if (o.json) return print_json(r);
  std::string line = fmt::format("{}: {} events, {}x{}", o.output.string(), r["events"].get<std::int64_t>(),
                                 r["width"].get<int>(), r["height"].get<int>());
  const auto add_share = [&](const char* key, const char* text) {
    if (const auto noise = r.find(key); noise != r.end() && (*noise)["share"].is_number())
      line += fmt::format(fmt::runtime(text), 100 * (*noise)["share"].get<double>());
  };
  add_share("render_noise", ", {:.1f} % of them from the noise of the renderer");
  if (r.contains("unsure") && r["unsure"]["events"].get<std::int64_t>() > 0)
    add_share("unsure", ", {:.1f} % of them unsure");
  add_share("camera_noise", " (camera's own noise: {:.1f} %)");
  fmt::print("{}\n", line);
  for (const auto& warning : r["warnings"]) console.warn(warning.get<std::string>());
  if (o.view) {
    if (const auto video = report.config["view"].get<std::string>(); video != "window")
      console.warn("no display: the events are in " + video);
  }
}

}  // namespace

void add_sense(CLI::App& app, Console& console) {
  const auto o = std::make_shared<SenseArguments>();
  CLI::App* sub =
      app.add_subcommand("sense", "simulate events from frames: an EXR stack, EXR files, pictures or video");
  sub->add_option("STACK", o->stack, "EXR stack, folder of EXR files or pictures, or video")->required();
  add_output(*sub, "-o,--output", o->output, "event file; its extension selects the format")->required();
  sub->add_option("--format", o->format, "format of the output, whatever its extension");
  add_pixels(sub, o.get());
  add_stages(*sub, o->stages, o->dropped);
  add_frames(sub, o.get());
  add_window(sub, o.get());
  add_view(sub, o.get());
  sub->add_flag("--json", o->json, "machine-readable output");
  add_examples(*sub,
               {"pecs sense out/stack -o events.raw",
                "pecs sense out/stack -o events.raw --duration 20ms --set contrast_threshold_on=0.3",
                "pecs sense out/stack -o events.raw --afk 50:520 --stc 10ms --erc 20MHz",
                "pecs sense video.mp4 -o events.h5 --photocurrent 1pA",
                "pecs sense video.mp4 -o events.h5 --chip davis346 --crop 80,0,479,360 --size 346x260",
                "pecs sense video.mp4 -o events.aedat4 --chip davis346 --size 346x260 --frames events.aedat4",
                "pecs sense video.mp4 -o events.h5 --preset v2e_noisy", "pecs sense video.mp4 --view -o events.raw"});
  sub->callback([o, &console] {
    resolve(*o, console);
    const sensor::SenseReport report = run(*o, console);
    console.record(o->output, {"sense", report.config, inputs(*o), report.results});
    print(*o, report, console);
  });
}

}  // namespace pecs::app
