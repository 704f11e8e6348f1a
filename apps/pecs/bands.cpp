// pecs bands: chooses wavelengths to render for a chip, and their weights.
#include <fmt/format.h>

#include "commands.h"
#include "help.h"
#include "pecs/sensor/choose_bands.h"
#include "units.h"

namespace pecs::app {
void add_bands(CLI::App& app, Console&) {
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
  sub->add_option("--placement", o->placement, "gauss or uniform")->capture_default_str();
  sub->add_option(
      "--illuminant", o->illuminant,
      "lamp: a name from lens_data/spectra, a CSV file (wavelength in nm, power), blackbody:T or daylight:T");
  add_quantity(*sub, "--min-wavelength", o->min_nm, "nm", "shortest wavelength (default: where QE and lamp begin)");
  add_quantity(*sub, "--max-wavelength", o->max_nm, "nm", "longest wavelength (default: where QE and lamp end)");
  sub->add_flag("--json", o->json, "machine-readable output");
  add_examples(*sub,
               {"pecs bands -n 6", "pecs bands --chip davis346 --illuminant blackbody:2856 --max-wavelength 700nm"});
  sub->callback([o] {
    Json options = {{"chip", o->chip}, {"n", o->n}, {"placement", o->placement}};
    if (!o->illuminant.empty()) options["illuminant"] = o->illuminant;
    if (o->min_nm) options["min_nm"] = *o->min_nm;
    if (o->max_nm) options["max_nm"] = *o->max_nm;
    const Json result = sensor::choose_bands(options);
    if (o->json) return print_json(result);
    fmt::print("wavelength_nm  weight_nm\n");
    for (const Json& band : result["bands"])
      fmt::print("{:13.3f}  {:9.3f}\n", band["lambda_nm"].get<double>(), band["weight_nm"].get<double>());
  });
}

}  // namespace pecs::app
