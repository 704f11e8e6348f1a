#include "pecs/sensor/choose_bands.h"

#include <algorithm>

#include "pecs/error.h"
#include "pecs/sensor/bands.h"
#include "pecs/sensor/chip.h"
#include "pecs/sensor/named_spectrum.h"

namespace pecs::sensor {
namespace {

Spectrum illuminant_from(const Json& pairs) {
  Spectrum s;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const std::string place = "illuminant[" + std::to_string(i) + "]";
    const Json& pair = pairs[i];
    if (!pair.is_array() || pair.size() != 2 || !pair[0].is_number() || !pair[1].is_number())
      throw bad_input("options", place, pair.dump().substr(0, 40), "[lambda_nm, power]");
    s.lambda_nm.push_back(pair[0]);
    s.value.push_back(pair[1]);
    if (i && s.lambda_nm[i] <= s.lambda_nm[i - 1])
      throw bad_input("options", place, pair.dump(), "increasing wavelengths");
    if (!(s.value[i] >= 0)) throw bad_input("options", place, pair.dump(), "power >= 0");
  }
  if (s.value.size() < 2) throw bad_input("options", "illuminant", "fewer than 2 points", "at least 2");
  return s;
}

}  // namespace

Json choose_bands(const Json& json) {
  JsonObject o(json, "options");
  const Chip chip = load_chip(o.text_or("chip", "imx636"));
  const int n = static_cast<int>(o.integer_or("n", 6, 1, 1000));
  const std::string placement = o.has("placement") ? o.one_of("placement", {"gauss", "uniform"}) : "gauss";
  const Json& given = o.any("illuminant");
  if (!given.is_null() && !given.is_array() && !given.is_string())
    o.fail("illuminant", "no list", "a name, or [[lambda_nm, power], ...]");
  const Spectrum lamp = given.is_null()     ? Spectrum{}
                        : given.is_string() ? named_spectrum(given)
                                            : illuminant_from(given);
  double min_nm = chip.relative_qe.min_nm(), max_nm = chip.relative_qe.max_nm();
  if (!given.is_null()) {
    min_nm = std::max(min_nm, lamp.min_nm());
    max_nm = std::min(max_nm, lamp.max_nm());
  }
  min_nm = o.number_or("min_nm", min_nm, {min_nm, max_nm});
  max_nm = o.number_or("max_nm", max_nm, {min_nm, max_nm});
  o.done();
  const auto chosen = placement == "uniform"
                          ? uniform_bands(n, min_nm, max_nm)
                          : gauss_bands(chip.relative_qe, given.is_null() ? nullptr : &lamp, n, min_nm, max_nm);
  Json out = Json::array();
  for (const Band& b : chosen) out.push_back({{"lambda_nm", b.lambda_nm}, {"weight_nm", b.weight_nm}});
  return {{"bands", out}};
}

}  // namespace pecs::sensor
