// pecs compare REAL SIM: scores of a simulation against a recording.
#include "pecs/metrics/compare.h"

#include <fmt/format.h>

#include <cmath>
#include <memory>

#include "commands.h"
#include "console.h"
#include "help.h"
#include "pecs/error.h"
#include "pecs/events/format.h"
#include "pecs/view/compare_plot.h"
#include "picture_file.h"
#include "units.h"

namespace pecs::app {
namespace {

struct CompareArguments {
  std::string real, sim, disk, picture;
  double window_us = 0;
  std::string normalisation = "shared", origin = "first-event";
  std::uint64_t seed = 1;
  bool realism = false, json = false;
};

std::string or_none(const std::optional<double>& value) { return value ? fmt::format("{:.3f}", *value) : "none"; }

void row(const char* name, const std::string& value, const std::string& floor, const std::string& note) {
  fmt::print("{:<22}{:>14}{:>14}  {}\n", name, value, floor, note);
}

void print_delays(const metrics::DelayComparison& e) {
  fmt::print("\n");
  row("delay behind the edge", "REAL", "SIM", "(degrees; 10, 50, 90 %)");
  const auto quantiles = [](const metrics::Delays& s, std::size_t p) -> std::string {
    const auto& q = s.quantiles_deg[p];
    return q ? fmt::format("{:.0f} {:.0f} {:.0f}", (*q)[0], (*q)[1], (*q)[2]) : "none";
  };
  for (const std::size_t p : {1, 0})
    row(p ? "ON" : "OFF", quantiles(e.real, p), quantiles(e.sim, p),
        fmt::format("overlap {}, earth mover's distance {} deg; events per edge {:.3f}, {:.3f}", or_none(e.overlap[p]),
                    or_none(e.earth_mover_deg[p]), e.real.per_edge[p], e.sim.per_edge[p]));
  row("sd of ON + next OFF", or_none(e.real.pair_sd_deg), or_none(e.sim.pair_sd_deg), "");
}

void print_realism(const metrics::Realism& r) {
  fmt::print("\n");
  row("cue", "REAL", "SIM", "area under the curve of a classifier that sees it alone (0.5: chance)");
  for (const auto& c : r.cues)
    row(c.name.c_str(), fmt::format("{:.3g}", c.real), fmt::format("{:.3g}", c.sim),
        fmt::format("{:.2f} ({:.2f} to {:.2f}); {}", c.auc.value, c.auc.interval.low, c.auc.interval.high, c.quantity));
  fmt::print("\n");
  for (const auto& sentence : metrics::sentences(r)) fmt::print("{}\n", sentence);
}

void print_table(const metrics::Comparison& c, const CompareArguments& a) {
  const auto parts = [](const std::array<double, 2>& p) {
    return fmt::format("REAL to SIM {:.4f}, SIM to REAL {:.4f}", p[0], p[1]);
  };
  const auto& d = c.distance;
  fmt::print("REAL: {}\nSIM:  {}\n\n", a.real, a.sim);
  row("distance", "REAL-SIM", "split half",
      fmt::format("({} normalisation, {}x{}, window {} us)", metrics::name_of(c.options.normalisation), c.width,
                  c.height, c.window_us));
  row("Chamfer", fmt::format("{:.4f}", d.chamfer()), c.floor ? fmt::format("{:.4f}", c.floor->chamfer()) : "none",
      parts(d.chamfer_parts));
  row("Gaussian", fmt::format("{:.5f}", d.gaussian()), c.floor ? fmt::format("{:.5f}", c.floor->gaussian()) : "none",
      parts(d.gaussian_parts));

  fmt::print("{:<22}{:>14}  Chamfer {:.4f} to {:.4f}, Gaussian {:.5f} to {:.5f} (bootstrap over time)\n",
             "95 % intervals", "", c.chamfer_interval.low, c.chamfer_interval.high, c.gaussian_interval.low,
             c.gaussian_interval.high);
  fmt::print("\n");
  row("stream", "REAL", "SIM", "");
  row("events", fmt::format("{}", c.real.events), fmt::format("{}", c.sim.events),
      fmt::format("ratio {:.4f}", static_cast<double>(c.sim.events) / static_cast<double>(c.real.events)));
  row("events per second", fmt::format("{:.4g}", c.real.rate_hz), fmt::format("{:.4g}", c.sim.rate_hz),
      fmt::format("correlation of the rate curves: all {}, ON {}, OFF {}", or_none(c.rate_correlation),
                  or_none(c.on_correlation), or_none(c.off_correlation)));
  row("ON fraction", fmt::format("{:.4f}", c.real.on_fraction), fmt::format("{:.4f}", c.sim.on_fraction), "");
  row("median interval, us", or_none(c.real.interval_median_us), or_none(c.sim.interval_median_us),
      fmt::format("earth mover's distance {} decades", or_none(c.interval_distance_decades)));
  fmt::print("{:<50}  correlation of the event maps: all {}, ON {}, OFF {}\n", "", or_none(c.map_correlation),
             or_none(c.on_map_correlation), or_none(c.off_map_correlation));
  if (c.delays) print_delays(*c.delays);
  if (c.realism) print_realism(*c.realism);
}

// `from`: "find", or a file with the output of `pecs align detect --json`.
metrics::TurningDisk disk_of(const std::string& from, const events::Stream& real, const std::string& file) {
  const Json detected = from == "find" ? found_disk(real, file) : parse_json_file(from);
  return metrics::turning_disk_from({detected, from == "find" ? file : from});
}

void run(const CompareArguments& a, Console& console) {
  metrics::CompareOptions options;
  options.normalisation = metrics::normalisation_from(a.normalisation);
  if (a.window_us > 0) options.window_us = std::llround(a.window_us);
  options.common_origin = a.origin == "zero";
  options.seed = a.seed;
  options.realism = a.realism;
  const auto read = [&](const std::string& file, bool whole) {  // reads only the events that are compared
    return whole || !options.window_us ? events::read_all(file)
                                       : events::read_part(file, *options.window_us, options.common_origin);
  };
  events::Stream real = read(a.real, !a.disk.empty()), sim = read(a.sim, false);
  if (!a.disk.empty()) options.disk = disk_of(a.disk, real, a.real);
  const auto comparison = metrics::compare(std::move(real), a.real, std::move(sim), a.sim, options);
  for (const auto& warning : comparison.warnings) console.warn(warning);
  if (!a.picture.empty()) {
    write_picture(a.picture, view::compare_picture(comparison), 1520);
    console.record(a.picture, {"compare", Json::object(), {a.real, a.sim}, metrics::to_json(comparison)});
  }
  if (a.json) return print_json(metrics::to_json(comparison), 2);
  print_table(comparison, a);
}

}  // namespace

void add_compare(CLI::App& app, Console& console) {
  auto a = std::make_shared<CompareArguments>();
  auto* command =
      app.add_subcommand("compare", "score a simulation against a real recording (docs/reference/metrics.md)");
  command->add_option("REAL", a->real, "recording, any event format")->required();
  command->add_option("SIM", a->sim, "simulation, same sensor size")->required();
  add_quantity(*command, "--window", a->window_us, "us",
               "duration to compare, from the origin, e.g. 100ms (default: all)")
      ->check(positive());
  command->add_option("--origin", a->origin, "origin of time: each stream's first event, or t = 0 of both")
      ->check(CLI::IsMember({"first-event", "zero"}))
      ->capture_default_str();
  command
      ->add_option(
          "--normalisation", a->normalisation,
          "shared (sensor size and window), eq16 (the paper's equation), paper (the arithmetic of its tables, with "
          "integer overflow)")
      ->check(CLI::IsMember({"shared", "eq16", "paper"}))
      ->capture_default_str();
  command->add_option("--seed", a->seed, "seed of the split-half floor and of --realism")->capture_default_str();
  command->add_option("--disk", a->disk,
                      "compare the delays behind a rotating disk's edges: find (in REAL), or a file with the output of "
                      "`pecs align detect REAL --json`");
  add_output(*command, "-o,--picture", a->picture, "picture of rates and delays (SVG, PNG or PDF)");
  command->add_flag("--realism", a->realism,
                    "train classifiers to tell patches of SIM from REAL, and name the cues that do (seconds)");
  command->add_flag("--json", a->json, "machine-readable output");
  add_examples(
      *command,
      {"pecs compare recording.raw events.raw", "pecs compare recording.raw events.raw --window 100ms -o scores.svg",
       "pecs compare recording.raw events.raw --realism", "pecs compare recording.raw events.raw --disk find --json"});
  command->callback([a, &console] { run(*a, console); });
}

}  // namespace pecs::app
