// pecs sense: an EXR stack in, events out.
#include "pecs/sensor/sense.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <charconv>

#include "commands.h"
#include "help.h"
#include "pecs/error.h"
#include "pecs/input/live.h"
#include "pecs/sensor/sense_options.h"
#include "talk.h"
#include "units.h"

namespace pecs::app {
namespace {

std::pair<std::string, double> key_value(const std::string& text, const std::string& option) {
  const auto equals = text.find('=');
  double value = 0;
  const char* end = text.data() + text.size();
  if (equals != std::string::npos) {
    const auto [stop, ec] = std::from_chars(text.data() + equals + 1, end, value);
    if (ec == std::errc() && stop == end) return {text.substr(0, equals), value};
  }
  throw Error(ExitCode::usage, fmt::format("{}: got {}, wanted KEY=NUMBER", option, text));
}

struct Options : sensor::SenseOptions {
  bool json = false;
  std::vector<std::string> parameters;
  std::string readout = "chip", bands = "all";
  std::optional<std::string> colour_space, live_source;
  bool view = false;
  input::LiveOptions live;
  std::optional<std::filesystem::path> ocio_config;
  double white_a = 0;
  const CLI::Option *seconds = nullptr, *shown = nullptr;  // have no meaning but with --view
};

bool is_camera(const Options& o) { return o.live_source && *o.live_source != "video"; }

void add_frames(CLI::App* sub, Options* o) {
  sub->add_option("--fps", o->times.fps, "frames per second, for frames without times of their own")
      ->transform(quantity("Hz"))
      ->check(positive());
  sub->add_option("--times", o->times.file_us, "text file of the frames' times, one in us a line");
  sub->add_option(
      "--colorspace", o->colour_space,
      "colours of pictures and video: srgb (default of integers), linear (of floats), or a space of the OCIO config");
  sub->add_option("--ocio", o->ocio_config, "OpenColorIO config (default: $OCIO)");
  sub->add_option("--photocurrent", o->light.photocurrent_a, "photocurrent of relative light 1 (white)")
      ->transform(quantity("A"))
      ->check(positive());
  sub->add_option("--bands", o->bands, "all, or mc:N: N bands drawn by their share in the light (Eq. 8-11)")
      ->check(CLI::Validator(
          [](std::string& text) { return sensor::monte_carlo_bands(text) ? "" : "wanted all or mc:N"; }, "all|mc:N"))
      ->capture_default_str();
  sub->add_flag("!--no-motion", o->motion, "frames alone, without the stack's layer motion between them");
  sub->add_option("--fnumber", o->light.fnumber, "f-number of the lens, for a stack of radiance")->check(positive());
  sub->add_option("--gain", o->light.gain,
                  "relative light: photocurrent [A] per sum of wavelength_nm QE L weight_nm (Eq. 6's C)")
      ->check(positive());
}

void add_pixels(CLI::App* sub, Options* o) {
  sub->add_option("--chip", o->chip, "chip profile: a name or a .json path")->capture_default_str();
  sub->add_option("--set", o->overrides, "KEY=VALUE: a value of the chip, in the profile's unit (repeatable)")
      ->allow_extra_args(false);
  sub->add_flag("--no-noise", o->no_noise, "without photon noise, leak, background events and mismatch");
  sub->add_option("--seed", o->seed, "seed of all random numbers")->capture_default_str();
  sub->add_option("--threads", o->threads, "0: all; the events do not depend on it")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  sub->add_option("--model", o->model.name,
                  fmt::format("pixel: {}; all but pecs are other simulators'", fmt::join(sensor::model_names(), ", ")))
      ->capture_default_str();
  sub->add_option("--param", o->parameters, "KEY=VALUE: a parameter of the other simulator's model (repeatable)")
      ->allow_extra_args(false);
  sub->add_option("--white", o->white_a, "photocurrent of white, for the other models (default: first frame's 99.5 %)")
      ->transform(quantity("A"))
      ->check(positive());
  sub->add_option("--readout", o->readout, "chip (row arbiter, rate limit, time base) or ideal")
      ->check(CLI::IsMember({"chip", "ideal"}))
      ->capture_default_str();
  add_output(*sub, "--labels", o->labels, "NPY file for each event's cause: 0 signal, 1 leak, 2 noise, 3 hot pixel");
}

void add_window(CLI::App* sub, Options* o) {
  sub->add_option("--warmup-loops", o->window.warmup_loops, "loops of a periodic stack before the output begins")
      ->check(CLI::Range(0, 1000000));
  sub->add_option("--start", o->window.start_us, "output begins this long after the start (or the warm-up)")
      ->transform(quantity("us"))
      ->check(CLI::Range(std::int64_t{0}, sensor::kLongestTime_us));
  sub->add_option("--duration", o->window.duration_us, "length of the output; a periodic stack is looped for it")
      ->transform(quantity("us"))
      ->check(CLI::Range(std::int64_t{1}, sensor::kLongestTime_us));
}

void add_live(CLI::App* sub, Options* o) {
  sub->add_option("--source", o->live_source, "with --view: video (default), or camera[:N] instead of a file")
      ->check(CLI::Validator(
          [](std::string& text) {
            const bool number = text.starts_with("camera:") && text.size() > 7 && text.size() < 11 &&
                                text.find_first_not_of("0123456789", 7) == std::string::npos;
            return number || text == "camera" || text == "video" ? "" : "wanted camera, camera:N or video";
          },
          "camera[:N]|video"));
  sub->add_flag("--view", o->view,
                "live: frame by frame from a video or camera, events on screen, or without display to OUTPUT.mp4");
  o->seconds =
      sub->add_option("--run-time", o->live.seconds, "end of a live run")->transform(quantity("s"))->check(positive());
  o->shown = sub->add_option("--window", o->live.picture_us, "time of the events shown together")
                 ->transform(quantity("us"))
                 ->check(CLI::Range(std::int64_t{1}, std::int64_t{1} << 40))
                 ->capture_default_str();
}

// What the words say, in numbers; throws usage for those that do not go together.
void resolve(Options& o, const Talk& talk) {
  o.quiet = talk.quiet();
  o.ideal_readout = o.readout == "ideal";
  o.model.white_fa = o.white_a * 1e15;
  for (const std::string& text : o.parameters) {
    const auto [at, is_new] = o.model.parameters.insert(key_value(text, "--param"));
    if (!is_new) throw Error(ExitCode::usage, fmt::format("--param {}: {} is set twice; set it once", text, at->first));
  }
  o.monte_carlo_bands = sensor::monte_carlo_bands(o.bands).value_or(0);
  const bool camera = is_camera(o);
  if (o.live_source && !o.view) throw Error(ExitCode::usage, fmt::format("--source {}: got no --view", *o.live_source));
  for (const CLI::Option* live : {o.seconds, o.shown})
    if (live->count() && !o.view) throw Error(ExitCode::usage, fmt::format("{}: got no --view", live->get_name()));
  if (camera != o.stack.empty())
    throw Error(ExitCode::usage, camera ? fmt::format("{}: got an input beside --source {}, wanted one of them",
                                                      o.stack.string(), *o.live_source)
                                        : "input: got nothing, wanted a stack, pictures or a video");
}

sensor::SenseReport run(Options& o) {
  const input::PictureOptions pictures{o.times, o.colour_space, o.ocio_config};
  if (!o.view) {
    o.source = input::open_frames(o.stack, pictures);
    return sensor::sense(o);
  }
  if (is_camera(o)) o.live.camera = o.live_source->size() > 7 ? std::stoi(o.live_source->substr(7)) : 0;
  o.live.file = o.stack;
  o.live.video = o.output.string() + ".mp4";
  return input::sense_live(o.live, o, pictures);
}

void say(const Options& o, const sensor::SenseReport& report, const Talk& talk) {
  const Json& r = report.results;
  if (o.json) {
    fmt::print("{}\n", text_of(r));
    return;
  }
  fmt::print("{}: {} events, {}x{}\n", o.output.string(), r["events"].get<std::int64_t>(), r["width"].get<int>(),
             r["height"].get<int>());
  if (const auto dropped = r["dropped"].get<std::int64_t>())
    talk.warn(fmt::format("{}: {} events dropped by the readout", o.output.string(), dropped));
  for (const auto& warning : r["warnings"]) talk.warn(warning.get<std::string>());
  if (o.view) {
    if (const auto video = report.config["view"].get<std::string>(); video != "window")
      talk.warn("no display: the events are shown in " + video);
  }
  const auto bad = r["bad_values"]["not_finite"].get<std::int64_t>() + r["bad_values"]["negative"].get<std::int64_t>();
  if (bad) talk.warn(fmt::format("{}: {} negative or not finite pixel values", o.stack.string(), bad));
}

}  // namespace

void add_sense(CLI::App& app, Talk& talk) {
  const auto o = std::make_shared<Options>();
  CLI::App* sub = app.add_subcommand("sense", "turn frames into events: an EXR stack, EXR files, pictures or video");
  sub->add_option("STACK", o->stack, "EXR stack, folder of EXR files or pictures, a video; nothing for a camera");
  add_output(*sub, "-o,--output", o->output, "event file; its name says the format")->required();
  sub->add_option("--format", o->format, "format of the output, whatever its name");
  add_pixels(sub, o.get());
  add_frames(sub, o.get());
  add_window(sub, o.get());
  add_live(sub, o.get());
  sub->add_flag("--json", o->json, "machine-readable output");
  add_examples(*sub, {"pecs sense out/stack -o events.raw",
                      "pecs sense out/stack -o events.raw --duration 20ms --set contrast_threshold_on=0.3",
                      "pecs sense video.mp4 -o events.h5 --photocurrent 1pA",
                      "pecs sense --source camera --view -o events.raw --run-time 10s"});
  sub->callback([o, &talk] {
    resolve(*o, talk);
    const sensor::SenseReport report = run(*o);
    std::vector<std::filesystem::path> inputs;
    if (!is_camera(*o)) inputs.push_back(o->stack);
    talk.record(o->output, {"sense", arguments(), report.config, inputs, report.results});
    say(*o, report, talk);
  });
}

}  // namespace pecs::app
