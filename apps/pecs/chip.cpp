// pecs chips, pecs chip info: the profiles of sensor/chips, and what light makes of them; pecs presets.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>

#include "commands.h"
#include "help.h"
#include "pecs/data_dir.h"
#include "pecs/sensor/lux.h"
#include "pecs/sensor/sense_options.h"
#include "units.h"

namespace pecs::app {
namespace {

std::vector<sensor::Chip> all_chips() {
  std::vector<std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator(data_dir("sensor/chips")))
    if (entry.path().extension() == ".json") files.push_back(entry.path().string());
  std::ranges::sort(files);
  std::vector<sensor::Chip> out;
  for (const std::string& file : files) out.push_back(sensor::load_chip(file));
  return out;
}

void list(bool json) {
  Json out = Json::array();
  for (const sensor::Chip& chip : all_chips()) {
    if (!json)
      fmt::print("{:<15} {}{}\n", chip.name, chip.description,
                 chip.trade_names.empty() ? "" : fmt::format(": {}", fmt::join(chip.trade_names, ", ")));
    out.push_back({{"name", chip.name}, {"description", chip.description}, {"trade_names", chip.trade_names}});
  }
  if (json) print_json(out);
}

void list_presets(bool json) {
  const Json all = sensor::presets();
  if (json) return print_json(all);
  for (const Json& preset : all)
    fmt::print("{:<20}{}\n{:<20}{}\n", preset["name"].get<std::string>(), preset["description"].get<std::string>(), "",
               preset["source"].get<std::string>());
}

struct InfoOptions {
  std::string chip;
  std::optional<double> lux, fnumber;
  double reflectance = 1;
  bool json = false;
};

void info(const InfoOptions& o) {
  const sensor::Chip chip = sensor::load_chip(o.chip);
  Json out = chip_to_json(chip);
  for (const auto& [key, source] : chip.sources) {
    out["values"][key]["source"] = source;
    out["values"][key]["range"] = {chip.ranges.at(key).min, chip.ranges.at(key).max};
  }
  if (o.lux) {
    const double at_chip = o.fnumber ? sensor::lux_at_chip(*o.lux, *o.fnumber, o.reflectance) : *o.lux;
    const std::vector<double> currents_a = photocurrent_of_lux(chip, at_chip);
    const auto light_of = [&](double current_a) {
      return Json{{"photocurrent_a", current_a},
                  {"corner_hz",
                   chip.corner_hz_per_a > 0 ? Json(chip.corner_hz_per_a * (current_a + chip.dark_current_a)) : Json()}};
    };
    if (chip.mosaic) {
      for (std::size_t k = 0; k < currents_a.size(); ++k)
        out["light"]["filters"][chip.mosaic->filters[k].name] = light_of(currents_a[k]);
    } else {
      out["light"] = light_of(currents_a[0]);
    }
    out["light"]["lux_at_chip"] = at_chip;
  }
  if (o.json) return print_json(out);
  fmt::print("{}: {}\n", chip.name, chip.description);
  if (!chip.trade_names.empty()) fmt::print("cameras: {}\n", fmt::join(chip.trade_names, ", "));
  for (const auto& [key, entry] : out["values"].items())
    fmt::print("  {:<26}{:.4g} {}: {}\n", key, entry["value"].get<double>(), entry["unit"].get<std::string>(),
               entry["source"].get<std::string>());
  if (!o.lux) return;
  const auto print_light = [&](const Json& light, const std::string& behind) {
    fmt::print("{:g} lux of 3000 K{}: {:.4g} lux at the chip{}, photocurrent {:.4g} fA, photoreceptor corner {}\n",
               *o.lux, o.fnumber ? fmt::format(" at f/{:g}", *o.fnumber) : "",
               out["light"]["lux_at_chip"].get<double>(), behind, 1e15 * light["photocurrent_a"].get<double>(),
               light["corner_hz"].is_null() ? "none" : fmt::format("{:.4g} Hz", light["corner_hz"].get<double>()));
  };
  if (!chip.mosaic) return print_light(out["light"], "");
  for (const auto& [name, light] : out["light"]["filters"].items()) print_light(light, ", behind " + name);
}

}  // namespace

void add_chip(CLI::App& app, Console&) {
  const auto json = std::make_shared<bool>(false);
  CLI::App* chips = app.add_subcommand("chips", "list the chip profiles, with the cameras that have them");
  chips->add_flag("--json", *json, "machine-readable output");
  add_examples(*chips, {"pecs chips"});
  chips->callback([json] { list(*json); });

  const auto json_of_presets = std::make_shared<bool>(false);
  CLI::App* presets =
      app.add_subcommand("presets", "list published settings of other simulators for pecs sense, with their sources");
  presets->add_flag("--json", *json_of_presets, "machine-readable output, with all values");
  add_examples(*presets, {"pecs presets", "pecs presets --json"});
  presets->callback([json_of_presets] { list_presets(*json_of_presets); });

  const auto o = std::make_shared<InfoOptions>();
  CLI::App* chip = app.add_subcommand("chip", "a chip profile: values and sources; its photocurrent in a given light");
  chip->require_subcommand(1);
  add_examples(*chip, {"pecs chip info imx636 --lux 100 --fnumber 2"});
  CLI::App* sub = chip->add_subcommand("info", "print values with sources; with --lux, photocurrent and corner");
  sub->add_option("CHIP", o->chip, "chip profile: a name or a .json path")->required();
  auto* lux = add_quantity(*sub, "--lux", o->lux, "lx",
                           "illuminance of the chip or, with --fnumber, of a surface, by 3000 K light")
                  ->check(positive());
  auto* fnumber = sub->add_option("--fnumber", o->fnumber, "f-number of the lens")->check(positive())->needs(lux);
  sub->add_option("--reflectance", o->reflectance, "of the surface, with --fnumber")
      ->check(CLI::Range(0.001, 1.0))
      ->capture_default_str()
      ->needs(fnumber);
  sub->add_flag("--json", o->json, "machine-readable output");
  add_examples(*sub, {"pecs chip info imx636", "pecs chip info imx636 --lux 100 --fnumber 2"});
  sub->callback([o] { info(*o); });
}

}  // namespace pecs::app
