// pecs bands: wavelengths to render for a chip, and their weights.
#include <fmt/ranges.h>

#include <filesystem>
#include <set>
#include <sstream>

#include "commands.h"
#include "pecs/data_dir.h"
#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/sensor/choose_bands.h"

namespace pecs::app {
namespace {

std::string illuminant_file(const std::string& name_or_path) {
  if (name_or_path.find_first_of("./") != std::string::npos) return name_or_path;
  const std::filesystem::path folder = data_dir("lens_data/spectra");
  if (const auto path = folder / (name_or_path + ".csv"); std::filesystem::is_regular_file(path)) return path.string();
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    if (entry.path().extension() == ".csv") names.insert(entry.path().stem().string());
  throw not_found(name_or_path, fmt::format("no file, and none of {}", fmt::join(names, ", ")));
}

// A table of wavelength and power: two numbers a line, separated by a comma or blanks; '#' starts a comment, and names
// of columns may stand above.
Json read_illuminant(const std::string& name_or_path) {
  const std::string path = illuminant_file(name_or_path);
  std::istringstream lines(read_text(path, 1 << 20));
  Json pairs = Json::array();
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number) {
    line = line.substr(0, line.find('#'));
    std::replace(line.begin(), line.end(), ',', ' ');
    if (line.find_first_not_of(" \t\r") == std::string::npos || (pairs.empty() && line.starts_with("wavelength_nm")))
      continue;
    std::istringstream words(line);
    double lambda_nm = 0, power = 0;
    if (!(words >> lambda_nm >> power))
      throw bad_input(path, "line " + std::to_string(number), line.substr(0, 40), "wavelength in nm, power");
    pairs.push_back({lambda_nm, power});
  }
  return pairs;
}

}  // namespace

void add_bands(CLI::App& app) {
  struct Options {
    std::string chip = "imx636", placement = "gauss", illuminant;
    int n = 6;
    std::optional<double> min_nm, max_nm;
    bool json = false;
  };
  const auto o = std::make_shared<Options>();
  CLI::App* sub = app.add_subcommand("bands", "choose wavelengths to render for a chip, and their weights");
  sub->add_option("--chip", o->chip, "chip profile: a name or a .json path")->capture_default_str();
  sub->add_option("-n", o->n, "number of bands")->capture_default_str();
  sub->add_option("--placement", o->placement, "gauss, strata (of equal light, at their medians) or uniform")
      ->capture_default_str();
  sub->add_option("--illuminant", o->illuminant,
                  "the lamp: a name of lens_data/spectra, or a CSV: wavelength in nm, power");
  sub->add_option("--min-nm", o->min_nm, "shortest wavelength, nm (default: where QE and lamp begin)");
  sub->add_option("--max-nm", o->max_nm, "longest wavelength, nm (default: where QE and lamp end)");
  sub->add_flag("--json", o->json, "machine output");
  sub->callback([o] {
    Json options = {{"chip", o->chip}, {"n", o->n}, {"placement", o->placement}};
    if (!o->illuminant.empty()) options["illuminant"] = read_illuminant(o->illuminant);
    if (o->min_nm) options["min_nm"] = *o->min_nm;
    if (o->max_nm) options["max_nm"] = *o->max_nm;
    const Json result = sensor::choose_bands(options);
    if (o->json) {
      fmt::print("{}\n", result.dump());
      return;
    }
    fmt::print("wavelength_nm  weight_nm\n");
    for (const Json& band : result["bands"])
      fmt::print("{:13.3f}  {:9.3f}\n", band["lambda_nm"].get<double>(), band["weight_nm"].get<double>());
  });
}

}  // namespace pecs::app
