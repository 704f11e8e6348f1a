#include "pecs/lens/prescription.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "pecs/data_dir.h"
#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/lens/exchange.h"
#include "pecs/lens/first_order.h"
#include "pecs/strict_json.h"
#include "pecs/text.h"

namespace pecs::lens {
namespace {

constexpr std::size_t kMaxBytes = 1 << 20, kMaxSurfaces = 200;
constexpr int kMaxPower = 30;

Glass read_medium(JsonObject medium) {
  const std::string name = medium.has("name") ? medium.text("name") : "";
  const std::string catalog = medium.has("catalog") ? medium.text("catalog") : "";
  const auto nd = medium.maybe_number("nd", {1, 4}), vd = medium.maybe_number("vd", {5, 150});
  medium.done();
  if (!catalog.empty()) {
    const auto glass = catalog_glass(catalog, name);
    if (!glass)
      medium.fail("name", fmt::format("unknown glass \"{}\" of {}", name, catalog), "a glass of lens_data/glasses");
    if (nd && std::abs(glass->nd() - *nd) > 5e-4)
      medium.fail("nd", fmt::format("{}", *nd), fmt::format("{:.5f}, as {} has it", glass->nd(), name));
    return *glass;
  }
  if (!nd) {
    if (name == "air") return Glass::air();
    medium.fail("nd", name.empty() ? "nothing" : fmt::format("unknown glass \"{}\" without nd", name),
                "a refractive index");
  }
  if (*nd == 1.0) return Glass::air();
  if (!vd) return Glass::constant(*nd, name);
  if (!name.empty())
    if (const auto glass = matching_glass(name, *nd, *vd); glass && glass->min_nm() <= 400 && glass->max_nm() >= 1000)
      return *glass;
  return Glass::from_nd_vd(*nd, *vd, name);
}

void read_powers(JsonObject& surface, const std::string& key, int parity, std::vector<double>& powers) {
  if (!surface.has(key)) return;
  const Json& terms = surface.any(key);
  if (!terms.is_object()) surface.fail(key, terms.dump().substr(0, 40), "an object {power: coefficient}");
  for (const auto& [text, value] : terms.items()) {
    const int power = number_from<int>(text).value_or(0);
    if (power < 2 || power > kMaxPower || power % 2 != parity)
      surface.fail(key, '"' + text + '"', fmt::format("an {} power from 2 to {}", parity ? "odd" : "even", kMaxPower));
    if (!value.is_number() || !std::isfinite(value.get<double>())) surface.fail(key, value.dump(), "a finite number");
    if (powers.size() <= static_cast<std::size_t>(power)) powers.resize(power + 1, 0.0);
    powers[power] += value.get<double>();
  }
}

Surface read_surface(JsonObject& json) {
  Surface s;
  const std::string type = json.one_of("type", {"sphere", "plane", "asphere", "stop"});
  const auto radius = json.maybe_number("radius");
  if (radius && *radius == 0) json.fail("radius", "0", "a radius, or null for a plane");
  if (type == "sphere" && !radius) json.fail("radius", "nothing", "a radius");
  if ((type == "plane" || type == "stop") && radius)
    json.fail("radius", fmt::format("{}", *radius), "null for a " + type);
  s.curvature = radius ? 1.0 / *radius : 0.0;
  if (type == "asphere") {
    s.conic = json.number_or("k", 0.0, {-1e4, 1e4});
    read_powers(json, "even_coeffs", 0, s.powers);
    read_powers(json, "odd_coeffs", 1, s.powers);
  }
  s.semi_diameter_mm = json.number("semi_diameter", {1e-6, 1e4});
  s.after = read_medium(json.object("medium_after"));
  return s;
}

void check_semi_diameter(const Surface& s, double semi_mm, const JsonObject& json) {
  if ((1.0 + s.conic) * s.curvature * s.curvature * semi_mm * semi_mm >= 1.0)
    json.fail("semi_diameter", fmt::format("{} mm", semi_mm),
              fmt::format("less than {:.6g} mm, where the surface of radius {:.6g} mm ends",
                          1.0 / (std::abs(s.curvature) * std::sqrt(1.0 + s.conic)), 1.0 / s.curvature));
}

// Neighbouring surfaces must not cross within 90 % of their radius. Beyond that they may: housing radii are often
// estimates, and an air gap that closes there only means that the real housing is narrower. Patents put a diaphragm at
// the vertex of a curved surface, which its plane then cuts: there the two surfaces around the diaphragm must not
// cross.
void check_order(const Prescription& lens, const std::vector<JsonObject>& list) {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < lens.surfaces.size(); ++i)
    if (i != lens.stop || !lens.stop_is_diaphragm()) order.push_back(i);
  for (std::size_t k = 0; k + 1 < order.size(); ++k) {
    const std::size_t a = order[k], b = order[k + 1];
    const double edge = 0.9 * std::min(lens.surfaces[a].semi_diameter_mm, lens.surfaces[b].semi_diameter_mm);
    for (int step = 0; step <= 16; ++step) {
      const double r = edge * step / 16.0, gap = lens.gap_mm(a, b, r);
      if (gap < -1e-6)
        list[a].fail("thickness",
                     fmt::format("surfaces {} and {} crossing at r = {:.4g} mm by {:.3g} mm", a, b, r, -gap),
                     "surfaces apart");
    }
  }
}

}  // namespace

Profile::Point Profile::at(double r2) const {
  const double root = std::sqrt(1.0 - (1.0 + conic) * curvature * curvature * r2);
  Point out{curvature * r2 / (1.0 + root), curvature / root};
  const double r = std::sqrt(r2);
  double term = 1.0, sag_over_r2 = 0;  // term: r^(p-2)
  for (std::size_t p = 2; p < powers.size(); ++p, term *= r) {
    sag_over_r2 += powers[p] * term;
    out.slope_over_r += static_cast<double>(p) * powers[p] * term;
  }
  out.sag_mm += sag_over_r2 * r2;
  return out;
}

double Prescription::gap_mm(std::size_t i, std::size_t j, double r) const {
  return surfaces[j].z_mm + surfaces[j].sag_mm(r) - surfaces[i].z_mm - surfaces[i].sag_mm(r);
}

bool Prescription::stop_is_diaphragm() const {
  const Surface& s = surfaces[stop];
  const double n_before = stop ? surfaces[stop - 1].after.nd() : 1.0;
  return s.is_plane() && s.after.nd() == n_before;
}

std::vector<double> Prescription::indices(double lambda_nm) const {
  std::vector<double> n;
  n.reserve(surfaces.size());
  for (std::size_t i = 0; i < surfaces.size(); ++i) {
    const Glass& glass = surfaces[i].after;
    if (!(lambda_nm >= glass.min_nm() && lambda_nm <= glass.max_nm()))
      throw bad_input(file, fmt::format("surfaces[{}].medium_after", i), fmt::format("{} nm", lambda_nm),
                      fmt::format("{} to {} nm, the range of {}", glass.min_nm(), glass.max_nm(),
                                  glass.name().empty() ? "its fallback" : glass.name()));
    n.push_back(glass.n(lambda_nm));
  }
  return n;
}

Json load_lens_json(const std::string& name_or_path) {
  std::filesystem::path path = name_or_path;
  const std::string kind = lower(path.extension().string());
  if (kind == ".zmx") return import_zmx(read_text(path, kMaxBytes), path.string());
  if (kind == ".dat" || kind == ".txt") return import_pbrt(read_text(path, kMaxBytes), path.string());
  path = find_data("lens_data/lenses", name_or_path);
  return parse_json(read_text(path, kMaxBytes), path.string());
}

Prescription load_prescription(const std::string& name_or_path) {
  const Json json = load_lens_json(name_or_path);
  const std::filesystem::path path = std::filesystem::is_regular_file(name_or_path)
                                         ? std::filesystem::path(name_or_path)
                                         : find_data("lens_data/lenses", name_or_path);
  JsonObject top(json, path.string());

  Prescription lens;
  lens.file = path.string();
  lens.sha256 = sha256_of_file(path);
  lens.name = top.text("name");
  if (top.has("units") && top.text("units") != "mm") top.fail("units", top.text("units"), "mm");
  // Notes about the file; not used.
  for (const char* key : {"order", "source", "licence", "estimated", "notes", "scale_from_patent", "housing_note",
                          "vd_note", "semi_diameter_note"})
    top.any(key);
  if (const Json& notes = top.any("notes"); notes.is_array())
    for (const Json& note : notes)
      if (note.is_string()) lens.notes.push_back(note);
  const auto pupil_mm = top.maybe_number("entrance_pupil_diameter", {1e-6, 1e4});
  const auto fnumber = top.maybe_number("fnumber", {1e-3, 1e6});
  const auto stop_max_mm = top.maybe_number("stop_max_semi_diameter", {1e-6, 1e4});
  if (top.has("nominal")) {
    JsonObject nominal = top.object("nominal");
    lens.nominal_efl_mm = nominal.maybe_number("efl");
    lens.nominal_fnumber = nominal.maybe_number("fno");
    nominal.maybe_number("hfov_deg");
    nominal.done();
  }

  std::vector<JsonObject> list = top.objects("surfaces");
  if (list.empty() || list.size() > kMaxSurfaces)
    top.fail("surfaces", fmt::format("{} surfaces", list.size()), fmt::format("1 to {}", kMaxSurfaces));
  if (!top.has("stop_index")) top.fail("stop_index", "nothing", "the index of the aperture stop");
  lens.stop = static_cast<std::size_t>(top.integer("stop_index", 0, static_cast<std::int64_t>(list.size()) - 1));
  top.done();

  double z = 0;
  for (std::size_t i = 0; i < list.size(); ++i) {
    Surface s = read_surface(list[i]);
    s.z_mm = z;
    const bool last = i + 1 == list.size();
    // The last thickness is the nominal distance to the film; focusing computes the real one.
    if (const auto thickness = list[i].maybe_number("thickness"); !last) {
      if (!thickness) list[i].fail("thickness", "nothing", "the distance to the next vertex");
      if (*thickness < 0 || *thickness > 1e4) list[i].fail("thickness", fmt::format("{}", *thickness), "0 to 10000 mm");
      z += *thickness;
    }
    list[i].done();
    check_semi_diameter(s, s.semi_diameter_mm, list[i]);
    lens.surfaces.push_back(std::move(s));
  }
  if (!lens.surfaces.back().after.is_air())
    list.back().fail("medium_after", "glass", "air, the medium before the film");

  check_order(lens, list);
  if (pupil_mm || fnumber) {
    const FirstOrder wide_open = first_order(lens, kLambdaD);
    Surface& stop = lens.surfaces[lens.stop];
    const double stop_per_pupil = stop.semi_diameter_mm / wide_open.entrance_pupil_diameter_mm;
    const double most_mm = stop_max_mm ? *stop_max_mm / stop_per_pupil : std::numeric_limits<double>::infinity();
    const double wanted_mm = std::min(pupil_mm ? *pupil_mm : wide_open.efl_mm / *fnumber, most_mm);
    const double semi_mm = stop_per_pupil * wanted_mm;
    check_semi_diameter(stop, semi_mm, list[lens.stop]);
    if (std::abs(semi_mm / stop.semi_diameter_mm - 1) > 1e-3)
      lens.notes.push_back(
          fmt::format("stop: semi-diameter {:.4g} mm for an entrance pupil of {:.4g} mm, instead of {:.4g}", semi_mm,
                      wanted_mm, stop.semi_diameter_mm));
    stop.semi_diameter_mm = semi_mm;
  }
  return lens;
}

}  // namespace pecs::lens
