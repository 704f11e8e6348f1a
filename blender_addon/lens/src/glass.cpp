#include "pecs/lens/glass.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <system_error>

#include "pecs/data_dir.h"
#include "pecs/error.h"
#include "pecs/strict_json.h"
#include "pecs/text.h"

namespace pecs::lens {
namespace {

constexpr double kHartmannExponent = 1.2;

std::string without_remark(const std::string& name) {
  const std::size_t at = name.find(" (");
  return at == std::string::npos ? name : name.substr(0, at);
}

std::vector<std::string> catalogs() {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(data_dir("lens_data/glasses")))
    if (entry.is_directory()) names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace

Glass Glass::constant(double n, std::string name) {
  Glass glass;
  glass.c_ = {n};
  glass.name_ = std::move(name);
  glass.source_ = "constant";
  return glass;
}

Glass Glass::from_nd_vd(double nd, double vd, std::string name) {
  // (n_g - n_F) / (n_F - n_C) depends on lambda0 alone and rises with it: bisect, then scale and shift.
  const double wanted = 0.6438 - 0.001682 * vd;
  const auto h = [](double lambda_nm, double lambda0_um) {
    return std::pow(lambda_nm * 1e-3 - lambda0_um, -kHartmannExponent);
  };
  double low = -3.0, high = 0.34;
  for (int i = 0; i < 80; ++i) {
    const double mid = 0.5 * (low + high);
    const double partial = (h(kLambdaG, mid) - h(kLambdaF, mid)) / (h(kLambdaF, mid) - h(kLambdaC, mid));
    (partial < wanted ? low : high) = mid;
  }
  const double lambda0 = 0.5 * (low + high);
  const double c = (nd - 1.0) / vd / (h(kLambdaF, lambda0) - h(kLambdaC, lambda0));
  Glass glass;
  glass.form_ = Form::hartmann;
  glass.c_ = {nd - c * h(kLambdaD, lambda0), c, lambda0};
  glass.min_nm_ = 350;
  glass.max_nm_ = 1100;
  glass.name_ = std::move(name);
  glass.source_ = "nd, vd";
  return glass;
}

Glass Glass::from_file(const std::filesystem::path& path) {
  const Json json = parse_json_file(path);
  JsonObject object(json, path.string());
  Glass glass;
  glass.name_ = object.text("name");
  glass.source_ = object.text("catalog");
  glass.form_ = static_cast<Form>(10 + object.integer("formula", 1, 3));
  glass.c_ = object.numbers("coefficients");
  if (glass.c_.size() % 2 == 0)
    object.fail("coefficients", std::to_string(glass.c_.size()) + " numbers", "an odd count");
  const std::vector<double> range = object.numbers("range_nm", {100, 20000});
  if (range.size() != 2 || range[0] >= range[1]) object.fail("range_nm", "no interval", "[from, to]");
  glass.min_nm_ = range[0];
  glass.max_nm_ = range[1];
  object.text("source");
  object.text("licence");
  const double nd = object.number("nd", {1, 4}), vd = object.number("vd", {1, 200});
  object.done();
  if (std::abs(glass.nd() - nd) > 2e-5)
    object.fail("nd", std::to_string(glass.nd()) + " from the formula", std::to_string(nd));
  if (std::abs(glass.vd() - vd) > 0.05)
    object.fail("vd", std::to_string(glass.vd()) + " from the formula", std::to_string(vd));
  return glass;
}

Glass Glass::with_nd(double nd) const {
  Glass glass = *this;
  glass.shift_ += nd - this->nd();
  return glass;
}

double Glass::n(double lambda_nm) const { return shift_ + unshifted(lambda_nm); }

double Glass::unshifted(double lambda_nm) const {
  const double um = lambda_nm * 1e-3, um2 = um * um;
  switch (form_) {
    case Form::constant:
      return c_[0];
    case Form::hartmann:
      return c_[0] + c_[1] * std::pow(um - c_[2], -kHartmannExponent);
    case Form::sellmeier1:
    case Form::sellmeier2: {
      double n2 = 1.0 + c_[0];
      for (std::size_t i = 1; i + 1 < c_.size(); i += 2)
        n2 += c_[i] * um2 / (um2 - (form_ == Form::sellmeier1 ? c_[i + 1] * c_[i + 1] : c_[i + 1]));
      return std::sqrt(n2);
    }
    case Form::polynomial3: {
      double n2 = c_[0];
      for (std::size_t i = 1; i + 1 < c_.size(); i += 2) n2 += c_[i] * std::pow(um, c_[i + 1]);
      return std::sqrt(n2);
    }
  }
  return 1.0;
}

std::optional<Glass> catalog_glass(const std::string& catalog, const std::string& name) {
  const auto path = data_dir("lens_data/glasses") / lower(catalog) / (without_remark(name) + ".json");
  std::error_code no_name_of_a_file;  // such as one too long
  if (!std::filesystem::is_regular_file(path, no_name_of_a_file)) return std::nullopt;
  return Glass::from_file(path);
}

std::optional<NamedGlass> glass_of_name(const std::string& name, const std::vector<std::string>& given) {
  const std::vector<std::string> all = catalogs();
  std::string base = lower(name).ends_with("_mold") ? name.substr(0, name.size() - 5) : name;
  std::vector<std::string> names = {name};
  if (base != name) names.push_back(base);
  names.push_back("N-" + base);
  for (const std::string& own : names) {
    for (const std::string& catalog : given)
      if (catalog_glass(catalog, own)) return NamedGlass{own, catalog, false};
    for (const std::string& catalog : all)
      if (catalog_glass(catalog, own)) return NamedGlass{own, catalog, true};
  }
  return std::nullopt;
}

std::optional<Glass> matching_glass(const std::string& name, double nd, double vd) {
  for (const std::string& catalog : catalogs())
    if (auto glass = catalog_glass(catalog, name);
        glass && std::abs(glass->nd() - nd) < 5e-4 && std::abs(glass->vd() - vd) < 0.3)
      return glass->with_nd(nd);
  return std::nullopt;
}

Glass named_glass(const std::string& name) {
  const std::size_t slash = name.find('/');
  for (const std::string& catalog : catalogs())
    if (slash == std::string::npos || name.substr(0, slash) == catalog)
      if (auto glass = catalog_glass(catalog, slash == std::string::npos ? name : name.substr(slash + 1)))
        return *std::move(glass);
  throw not_found(name, fmt::format("no such glass in lens_data/glasses ({})", fmt::join(catalogs(), ", ")));
}

}  // namespace pecs::lens
