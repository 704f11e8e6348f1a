#include "stage_arguments.h"

#include <fmt/format.h>

#include "commands.h"
#include "units.h"

namespace pecs::app {
namespace {

CLI::Option* add_trail(CLI::App& command, sensor::StageOptions& stages, const char* name, sensor::TrailFilter kind,
                       const char* help) {
  return command
      .add_option_function<std::int64_t>(
          name,
          [&stages, kind](std::int64_t t_us) {
            stages.trail = kind;
            stages.trail_us = t_us;
          },
          help)
      ->transform(quantity("us"))
      ->check(CLI::Range(static_cast<std::int64_t>(sensor::kTrail_us.min),
                         static_cast<std::int64_t>(sensor::kTrail_us.max)));
}

CLI::Option* add_afk(CLI::App& command, sensor::StageOptions& stages, const char* name, bool pass, const char* help) {
  const auto set = [&stages, name, pass](const std::string& text) {
    const auto band = numbers_of<double>(text, ':', 2);
    const Range range = sensor::kAfk_hz;
    if (!band || !((*band)[0] >= range.min && (*band)[0] < (*band)[1] && (*band)[1] <= range.max))
      throw CLI::ValidationError(
          name, fmt::format("got '{}', wanted LOW:HIGH in Hz, from {} to {}", text, range.min, range.max));
    stages.afk = sensor::Afk{.low_hz = (*band)[0], .high_hz = (*band)[1], .pass = pass};
  };
  return command.add_option_function<std::string>(name, set, help)->type_name("BAND[Hz]");
}

void add_afk_counts(CLI::App& command, sensor::StageOptions& stages) {
  const auto set = [&stages](const std::string& text) {
    const auto counts = numbers_of<int>(text, ':', 2);
    const Range range = sensor::kAfkCounts;
    if (!counts || (*counts)[1] < range.min || (*counts)[1] > (*counts)[0] || (*counts)[0] > range.max)
      throw CLI::ValidationError(
          "--afk-counts",
          fmt::format("got '{}', wanted START:STOP from {} to {}, STOP not above START", text, range.min, range.max));
    stages.afk_counts = sensor::AfkCounts{.start = (*counts)[0], .stop = (*counts)[1]};
  };
  command
      .add_option_function<std::string>("--afk-counts", set,
                                        "anti-flicker: periods after which a block flickers, and number of them below "
                                        "which it no longer does (default: 6:4)")
      ->type_name("START:STOP");
}

void add_roi(CLI::App& command, sensor::StageOptions& stages) {
  const auto set = [&stages](const std::vector<std::string>& windows) {
    for (const std::string& text : windows) {
      const auto w = numbers_of<int>(text, ',', 4);
      if (!w || (*w)[0] < 0 || (*w)[1] < 0 || (*w)[2] < 1 || (*w)[3] < 1 || std::ranges::max(*w) > 8192)
        throw CLI::ValidationError("--roi", fmt::format("got '{}', wanted X,Y,WIDTH,HEIGHT in pixels", text));
      stages.roi.push_back({(*w)[0], (*w)[1], (*w)[2], (*w)[3]});
    }
  };
  command
      .add_option_function<std::vector<std::string>>(
          "--roi", set, "region of interest, once per window; pixels outside all windows are off")
      ->type_name("X,Y,W,H")
      ->allow_extra_args(false);
}

}  // namespace

void add_stages(CLI::App& command, sensor::StageOptions& stages, std::optional<std::filesystem::path>& dropped) {
  add_roi(command, stages);
  command.add_option("--mask", stages.mask, "file of pixels whose events are dropped: pixel X Y, row Y, column X");
  CLI::Option* stop =
      add_afk(command, stages, "--afk", false, "anti-flicker: drop events that flicker in this band, such as 50:520");
  add_afk(command, stages, "--afk-pass", true, "anti-flicker: keep only events that flicker in this band")
      ->excludes(stop);
  add_afk_counts(command, stages);
  CLI::Option* trail = add_trail(command, stages, "--trail", sensor::TrailFilter::first,
                                 "keep the first event of a burst, whose events follow each other within this time");
  CLI::Option* stc =
      add_trail(command, stages, "--stc", sensor::TrailFilter::second, "keep the second event of a burst");
  CLI::Option* keep = add_trail(command, stages, "--stc-keep", sensor::TrailFilter::all_but_first,
                                "drop the first event of a burst and keep its trail");
  trail->excludes(stc)->excludes(keep);
  stc->excludes(keep);
  add_quantity(command, "--erc", stages.erc_hz, "Hz", "event rate control: most events per second, in each 200 us")
      ->check(CLI::Range(sensor::kErc_hz.min, sensor::kErc_hz.max));
  add_output(command, "--dropped", dropped,
             "NPY file of the events that mask (2), AFK (3), trail filter (4) and ERC (5) dropped: t, x, y, p, stage");
}

}  // namespace pecs::app
