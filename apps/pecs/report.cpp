// pecs report: a page about a simulation, its render and its recording.
#include <fmt/format.h>

#include <memory>

#include "commands.h"
#include "console.h"
#include "help.h"
#include "pecs/view/report_page.h"
#include "units.h"

namespace pecs::app {
namespace {

struct ReportArguments {
  std::string real, sim, stack, lens_svg, output;
  double window_us = 0;
  bool json = false;
};

void run(const ReportArguments& a, Console& console) {
  view::ReportInputs inputs;
  std::vector<std::filesystem::path> files;
  const auto take = [&](const std::string& text, std::optional<std::filesystem::path>& into) {
    if (text.empty()) return;
    into = text;
    files.emplace_back(text);
  };
  take(a.real, inputs.real);
  take(a.sim, inputs.sim);
  take(a.stack, inputs.stack);
  take(a.lens_svg, inputs.lens_svg);
  if (a.window_us > 0) inputs.compare.window_us = std::llround(a.window_us);

  const Json summary = view::write_report_page(inputs, a.output);
  const Json config = {{"window_us", or_null(inputs.compare.window_us)}};
  console.record(a.output, {"report", config, files, summary});
  if (a.json) return print_json(summary, 2);
  fmt::print("{}\n", a.output);
}

}  // namespace

void add_report(CLI::App& app, Console& console) {
  auto a = std::make_shared<ReportArguments>();
  auto* command =
      app.add_subcommand("report", "write an HTML page: render, lens, simulated and recorded events, scores");
  command->add_option("--real", a->real, "recording");
  command->add_option("--sim", a->sim, "simulated events, with their .run.json");
  command->add_option("--stack", a->stack, "EXR stack of the simulation");
  command->add_option("--lens-svg", a->lens_svg, "drawing of the lens by `pecs lens draw`");
  add_quantity(*command, "--window", a->window_us, "us",
               "duration to score, from each stream's first event, e.g. 100ms")
      ->check(positive());
  add_output(*command, "-o,--output", a->output, "HTML file to write")->required();
  command->add_flag("--json", a->json, "machine-readable output");
  add_examples(*command, {"pecs report --sim events.raw --stack out/stack -o report.html",
                          "pecs report --real recording.raw --sim events.raw --window 100ms -o report.html"});
  command->callback([a, &console] { run(*a, console); });
}

}  // namespace pecs::app
