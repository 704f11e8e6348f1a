// Spectra by name, and refractive indices of glasses.
#include <ranges>

#include "guard.h"
#include "pecs/data_dir.h"
#include "pecs/error.h"
#include "pecs/lens/glass.h"
#include "pecs/sensor/named_spectrum.h"

using pecs::capi::given;
using pecs::capi::guard;

namespace {

constexpr std::size_t kBasisColumns = 4;  // wavelength and three functions

std::vector<std::vector<double>> rows_of(const std::string& name) {
  if (name.starts_with("basis/"))
    return pecs::sensor::read_table(pecs::data_dir("lens_data/spectra") / (name + ".csv"), kBasisColumns);
  const pecs::sensor::Spectrum s = pecs::sensor::named_spectrum(name);
  std::vector<std::vector<double>> rows;
  for (std::size_t i = 0; i < s.value.size(); ++i) rows.push_back({s.lambda_nm[i], s.value[i]});
  return rows;
}

pecs::lens::Glass glass_from(const char* options_json) {
  const pecs::Json json = pecs::capi::options_from(&given(options_json, "options"));
  pecs::JsonObject o(json, "options");
  if (o.has("name")) {
    const std::string name = o.text("name");
    o.done();
    return pecs::lens::named_glass(name);
  }
  const double nd = o.number("nd", {1, 4}), vd = o.number("vd", {10, 120});
  o.done();
  return pecs::lens::Glass::from_nd_vd(nd, vd, "nd, vd");
}

}  // namespace

extern "C" {

char* pecs_spectrum(const char* name_or_path, pecs_error* error) {
  return guard(error, [&] { return pecs::capi::hand_over(pecs::Json(rows_of(&given(name_or_path, "name_or_path")))); });
}

int64_t pecs_glass_index(const char* options_json, const double* lambda_nm, int64_t count, double* index,
                         int64_t capacity, pecs_error* error) {
  return guard(error, [&] {
    const pecs::lens::Glass glass = glass_from(options_json);
    pecs::capi::check_count(count);
    const std::span at(count ? &given(lambda_nm, "lambda_nm") : nullptr, static_cast<std::size_t>(count));
    for (const double nm : at)
      if (!(nm >= glass.min_nm() && nm <= glass.max_nm()))
        throw pecs::bad_input(glass.name(), "lambda_nm", fmt::format("{} nm", nm),
                              fmt::format("{} to {} nm, the range of its formula", glass.min_nm(), glass.max_nm()));
    return pecs::capi::copy_out(at | std::views::transform([&](double nm) { return glass.n(nm); }), index, capacity);
  });
}

}  // extern "C"
