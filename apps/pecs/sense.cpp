// pecs sense: an EXR stack in, events out.
#include "pecs/sensor/sense.h"

#include <fmt/format.h>

#include "commands.h"
#include "pecs/run_record.h"

namespace pecs::app {

void add_sense(CLI::App& app) {
  struct Options : sensor::SenseOptions {
    bool json = false;
  };
  const auto o = std::make_shared<Options>();
  CLI::App* sub = app.add_subcommand("sense", "turn an EXR stack into events");
  sub->add_option("stack", o->stack, "folder of the stack")->required();
  sub->add_option("-o,--output", o->output, "event file; its name says the format")->required();
  sub->add_option("--format", o->format, "format of the output, whatever its name");
  sub->add_option("--chip", o->chip, "chip profile: a name or a .json path")->capture_default_str();
  sub->add_option("--set", o->overrides, "KEY=VALUE: a value of the chip, in the profile's unit (repeatable)")
      ->allow_extra_args(false);
  sub->add_flag("--no-noise", o->no_noise, "without photon noise, leak, background events and mismatch");
  sub->add_option("--seed", o->seed, "of all random numbers")->capture_default_str();
  sub->add_option("--threads", o->threads, "0: all; the events do not depend on it")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  sub->add_option("--fps", o->fps, "frames per second, for a folder without stack.json")->check(CLI::PositiveNumber);
  sub->add_option("--fnumber", o->fnumber, "of the lens, for a stack of radiance")->check(CLI::PositiveNumber);
  sub->add_option("--warmup-loops", o->warmup_loops, "loops of a periodic stack before the output begins")
      ->check(CLI::Range(0, 1000000));
  sub->add_option("--start-us", o->start_us, "output begins this long after the start (or the warm-up), us")
      ->check(CLI::NonNegativeNumber);
  sub->add_option("--duration-us", o->duration_us, "length of the output, us; a periodic stack is looped for it")
      ->check(CLI::PositiveNumber);
  sub->add_flag("--json", o->json, "machine output");
  sub->add_flag("--quiet", o->quiet, "no progress");
  sub->callback([o] {
    const sensor::SenseReport report = sensor::sense(*o);
    write_run_record(o->output, {"sense", arguments(), report.config, {o->stack}, report.results});
    const Json& r = report.results;
    if (o->json) {
      fmt::print("{}\n", r.dump());
      return;
    }
    fmt::print("{}: {} events, {}x{}\n", o->output.string(), r["events"].get<std::int64_t>(), r["width"].get<int>(),
               r["height"].get<int>());
    const auto bad =
        r["bad_values"]["not_finite"].get<std::int64_t>() + r["bad_values"]["negative"].get<std::int64_t>();
    if (bad) fmt::print(stderr, "pecs: {}: {} negative or not finite pixel values\n", o->stack.string(), bad);
  });
}

}  // namespace pecs::app
