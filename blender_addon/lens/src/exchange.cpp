#include "pecs/lens/exchange.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <set>
#include <sstream>

#include "pecs/error.h"
#include "pecs/text.h"

namespace pecs::lens {
namespace {

constexpr double kPlaneRadius = 1e7;  // pbrt has no plane: radius 0 is the stop

std::string utf8(const std::string& bytes) {
  const bool le = bytes.starts_with("\xFF\xFE"), be = bytes.starts_with("\xFE\xFF");
  if (!le && !be) return bytes.starts_with("\xEF\xBB\xBF") ? bytes.substr(3) : bytes;
  std::string out;
  for (std::size_t i = 2; i + 1 < bytes.size(); i += 2) {
    const unsigned char low = bytes[i + (be ? 1 : 0)], high = bytes[i + (be ? 0 : 1)];
    out += high ? '?' : static_cast<char>(low < 0x80 ? low : '?');  // keywords and numbers are ASCII
  }
  return out;
}

std::vector<std::string> words_of(const std::string& line) {
  std::istringstream stream(line);
  std::vector<std::string> words;
  for (std::string word; stream >> word;) words.push_back(word);
  return words;
}

constexpr int kMaxParameter = 8;  // of an asphere's PARM lines
const std::map<std::string, double> kUnitsMm{{"MM", 1}, {"CM", 10}, {"IN", 25.4}, {"METER", 1000}};
const std::set<std::string> kShapes{"SQAP", "ELAP", "UDAD", "OBSC", "SQOB", "ELOB", "SPID"};  // and obscurations

struct Place {
  std::string file;
  std::size_t line;
  [[noreturn]] void fail(const std::string& got, const std::string& wanted) const {
    throw bad_input(file, fmt::format("line {}", line), got, wanted);
  }
  double number(const std::vector<std::string>& words, std::size_t i) const {
    if (i >= words.size()) fail("nothing after " + words.front(), "a number");
    const auto x = number_from<double>(words[i].substr(words[i].starts_with('+') ? 1 : 0));
    if (!x || !std::isfinite(*x)) fail('"' + words[i].substr(0, 40) + '"', "a number");
    return *x;
  }
};

struct ZemaxSurface {
  std::string type = "STANDARD", glass;
  double curvature = 0, thickness = 0, semi = 0, conic = 0, nd = 0, vd = 0;
  double clear = 0;  // radius of its own aperture (CLAP); 0: none
  int solve = 0;     // of the glass: 0: by its name, 1: a model of these nd and Vd, 2: that of another surface
  std::map<int, double> parameters;
  bool stop = false;
  Place place;
  std::string shape;  // keyword of an aperture that is no open circle on the axis
  Place shape_place;
};

Json medium_of(const ZemaxSurface& s, const std::vector<std::string>& catalogs, std::vector<std::string>& notes) {
  if (s.glass.empty()) return {{"name", "air"}};
  if (s.glass == "MIRROR") s.place.fail("a mirror", "a lens");
  if (const auto found = glass_of_name(s.glass, catalogs)) {
    if (found->name != s.glass || found->is_of_another_catalog)
      notes.push_back(
          fmt::format("line {}: glass {} read as {} of {}", s.place.line, s.glass, found->name, found->catalog));
    return {{"name", found->name}, {"catalog", found->catalog}};
  }
  // The numbers behind a name are data for a model glass; else what Zemax once wrote there, by default 1.5 and 40.
  const bool placeholder = s.solve != 1 && s.nd == 1.5 && s.vd == 40;
  if (s.nd > 1 && s.vd > 0 && s.solve != 2 && !placeholder) {
    Json medium{{"nd", s.nd}, {"vd", s.vd}};
    if (s.glass != "___BLANK") medium["name"] = s.glass;
    if (s.solve != 1)
      notes.push_back(fmt::format("line {}: unknown glass {} replaced by nd {} and Vd {} of this line", s.place.line,
                                  s.glass, s.nd, s.vd));
    return medium;
  }
  s.place.fail(fmt::format("unknown glass \"{}\" without nd and Vd{}", s.glass,
                           placeholder ? " (1.5 and 40 are Zemax's placeholder)" : ""),
               "a glass of lens_data/glasses");
}

// Coefficients p of the file in its unit to mm: A_p scales with unit^(1-p).
void add_powers(Json& surface, const ZemaxSurface& s, bool even, double unit_mm) {
  Json even_coeffs = Json::object(), odd_coeffs = Json::object();
  for (const auto& [index, value] : s.parameters) {
    const int power = even ? 2 * index : index;
    if (value == 0) continue;
    if (power == 1) s.place.fail("a term linear in r", "powers from 2");
    (power % 2 ? odd_coeffs : even_coeffs)[std::to_string(power)] = value * std::pow(unit_mm, 1 - power);
  }
  if (!even_coeffs.empty()) surface["even_coeffs"] = even_coeffs;
  if (!odd_coeffs.empty()) surface["odd_coeffs"] = odd_coeffs;
}

struct ZemaxFile {
  std::string name;
  double unit_mm = 1;
  std::vector<std::string> catalogs;
  double pupil_mm = 0, fnumber = 0;  // the system's aperture, where it is one of these
  std::string configurations = "1";
  std::vector<ZemaxSurface> surfaces;  // the object first, the image last
};

ZemaxFile read_zemax(const std::string& bytes, const std::string& file) {
  std::istringstream lines(utf8(bytes));
  ZemaxFile zemax;
  std::size_t number = 0;
  for (std::string line; std::getline(lines, line);) {
    const Place place{file, ++number};
    const std::vector<std::string> words = words_of(line);
    if (words.empty()) continue;
    const std::string& key = words[0];
    if (key == "MODE" && words.size() > 1 && words[1] != "SEQ") place.fail("mode " + words[1], "sequential (SEQ)");
    if (key == "UNIT" && words.size() > 1) {
      const auto unit = kUnitsMm.find(words[1]);
      if (unit == kUnitsMm.end()) place.fail("unit " + words[1], "MM, CM, IN or METER");
      zemax.unit_mm = unit->second;
    }
    if (key == "NAME") zemax.name = line.substr(line.find("NAME") + 4);
    if (key == "ENPD") zemax.pupil_mm = place.number(words, 1);
    if (key == "FNUM") zemax.fnumber = place.number(words, 1);
    if (key == "MNUM" && words.size() > 1) zemax.configurations = words[1];
    if (key == "GCAT") zemax.catalogs.assign(words.begin() + 1, words.end());
    if (key == "SURF") {
      zemax.surfaces.emplace_back();
      zemax.surfaces.back().place = place;
      continue;
    }
    if (zemax.surfaces.empty()) continue;
    ZemaxSurface& s = zemax.surfaces.back();
    if (key == "TYPE" && words.size() > 1) s.type = words[1];
    if (key == "CURV") s.curvature = place.number(words, 1);
    if (key == "DISZ")
      s.thickness =
          words.size() > 1 && words[1] == "INFINITY" ? std::numeric_limits<double>::infinity() : place.number(words, 1);
    if (key == "DIAM") s.semi = place.number(words, 1);
    if (key == "CLAP") s.clear = place.number(words, 2);
    const bool ring = key == "CLAP" && place.number(words, 1) > 0;
    const bool off_axis = key == "OBDC" && (place.number(words, 1) != 0 || place.number(words, 2) != 0);
    if (kShapes.contains(key) || ring || off_axis) s.shape = key, s.shape_place = place;
    if (key == "CONI") s.conic = place.number(words, 1);
    if (key == "STOP") s.stop = true;
    if (key == "PARM")
      if (const double index = place.number(words, 1); index >= 1 && index <= kMaxParameter)
        s.parameters[static_cast<int>(index)] = place.number(words, 2);
    if (key == "GLAS") {
      if (words.size() < 2) place.fail("a glass without a name", "GLAS name ...");
      s.glass = printable(words[1]);
      if (words.size() > 5) {
        s.solve = static_cast<int>(std::clamp(place.number(words, 2), -1.0, 100.0));
        s.nd = place.number(words, 4);
        s.vd = place.number(words, 5);
      }
    }
  }
  if (zemax.surfaces.size() < 3)
    throw bad_input(file, "", fmt::format("{} surfaces", zemax.surfaces.size()), "a Zemax lens");
  return zemax;
}

}  // namespace

Json import_zmx(const std::string& bytes, const std::string& file) {
  const auto [name, unit_mm, catalogs, pupil, fnumber, configurations, surfaces] = read_zemax(bytes, file);
  std::vector<std::string> notes;
  if (configurations != "1")
    notes.push_back(fmt::format("one of {} configurations, in which it was saved", printable(configurations)));
  Json out_surfaces = Json::array();
  std::optional<std::size_t> stop;
  double stop_clear = 0;
  for (std::size_t i = 1; i + 1 < surfaces.size(); ++i) {
    const ZemaxSurface& s = surfaces[i];
    if (s.type != "STANDARD" && s.type != "EVENASPH" && s.type != "ODDASPHE")
      s.place.fail("surface type " + s.type, "STANDARD, EVENASPH or ODDASPHE");
    if (!s.shape.empty()) s.shape_place.fail("aperture " + s.shape, "open circles on the axis");
    const bool asphere = s.type != "STANDARD" || s.conic != 0;
    const bool in_air = s.glass.empty() && (i == 1 || surfaces[i - 1].glass.empty());
    if (in_air && s.curvature == 0 && s.type == "STANDARD" && !s.stop && s.clear == 0) {
      if (out_surfaces.empty()) continue;
      if (!std::isfinite(s.thickness) || out_surfaces.back()["thickness"].is_null())
        s.place.fail("an infinite thickness between surfaces", "a finite one");
      out_surfaces.back()["thickness"] = out_surfaces.back()["thickness"].get<double>() + s.thickness * unit_mm;
      continue;
    }
    // DIAM is as wide as the rays of the file's fields, except that of the stop; CLAP blocks rays.
    const double semi = s.clear != 0 && !(s.stop && s.semi > 0 && s.semi < s.clear) ? s.clear : s.semi;
    if (!(semi > 0)) s.place.fail("no semi-diameter (DIAM, CLAP)", "one above 0");
    if (s.stop) stop = out_surfaces.size(), stop_clear = s.clear;
    Json surface{{"type", asphere            ? "asphere"
                          : s.curvature != 0 ? "sphere"
                          : s.stop && in_air ? "stop"
                                             : "plane"},
                 {"radius", s.curvature != 0 ? Json(unit_mm / s.curvature) : Json(nullptr)},
                 {"thickness", std::isfinite(s.thickness) ? Json(s.thickness * unit_mm) : Json(nullptr)},
                 {"medium_after", medium_of(s, catalogs, notes)},
                 {"semi_diameter", semi * unit_mm}};
    if (asphere) surface["k"] = s.conic;
    if (s.type != "STANDARD") add_powers(surface, s, s.type == "EVENASPH", unit_mm);
    out_surfaces.push_back(std::move(surface));
  }
  if (!stop) throw bad_input(file, "", "no STOP line", "an aperture stop");
  const std::size_t first = name.find_first_not_of(" \t\r"), last = name.find_last_not_of(" \t\r");
  Json out{{"name", first == std::string::npos ? printable(std::filesystem::path(file).stem().string())
                                               : printable(name.substr(first, last - first + 1))},
           {"units", "mm"},
           {"source", {{"file", printable(std::filesystem::path(file).filename().string())}, {"format", "Zemax"}}},
           {"stop_index", *stop},
           {"surfaces", out_surfaces}};
  if (!notes.empty()) out["notes"] = notes;
  if (pupil > 0) out["entrance_pupil_diameter"] = pupil * unit_mm;
  if (fnumber > 0) out["fnumber"] = fnumber;
  if (stop_clear > 0) out["stop_max_semi_diameter"] = stop_clear * unit_mm;
  return out;
}

Json import_pbrt(const std::string& text, const std::string& file) {
  std::istringstream lines(text);
  Json surfaces = Json::array();
  std::optional<std::size_t> stop;
  std::size_t number = 0;
  for (std::string line; std::getline(lines, line);) {
    const Place place{file, ++number};
    const std::vector<std::string> words = words_of(line.substr(0, line.find('#')));
    if (words.empty()) continue;
    if (words.size() != 4) place.fail(fmt::format("{} columns", words.size()), "radius thickness index diameter");
    double v[4];
    for (std::size_t i = 0; i < 4; ++i) v[i] = place.number(words, i);
    const bool is_stop = v[0] == 0;
    if (is_stop) {
      if (stop) place.fail("a second stop (radius 0)", "one");
      stop = surfaces.size();
    }
    const bool plane = !is_stop && std::abs(v[0]) >= kPlaneRadius;
    const bool air = v[2] == 0 || v[2] == 1;
    surfaces.push_back({{"type", is_stop ? "stop"
                                 : plane ? "plane"
                                         : "sphere"},
                        {"radius", is_stop || plane ? Json(nullptr) : Json(v[0])},
                        {"thickness", v[1]},
                        {"medium_after", air || is_stop ? Json{{"name", "air"}} : Json{{"nd", v[2]}}},
                        {"semi_diameter", 0.5 * v[3]}});
  }
  if (!stop) throw bad_input(file, "", "no line of radius 0", "the aperture stop");
  return {{"name", printable(std::filesystem::path(file).stem().string())},
          {"units", "mm"},
          {"source", {{"file", printable(std::filesystem::path(file).filename().string())}, {"format", "pbrt"}}},
          {"estimated", "pbrt's format holds one index per glass: no dispersion."},
          {"stop_index", *stop},
          {"surfaces", surfaces}};
}

std::string export_pbrt(const Prescription& lens, double lambda_nm, double film_z_mm) {
  const std::vector<double> n = lens.indices(lambda_nm);
  std::string out = fmt::format("# {}\n# index at {} nm; radius 0 = stop; mm\n# radius thickness index diameter\n",
                                lens.name, lambda_nm);
  for (std::size_t i = 0; i < lens.surfaces.size(); ++i) {
    const Surface& s = lens.surfaces[i];
    if (!s.is_sphere())
      throw Error(ExitCode::unsupported,
                  fmt::format("{}: surfaces[{}]: pbrt's format holds no aspheres", lens.file, i));
    const bool diaphragm = i == lens.stop && s.after.is_air() && lens.stop_is_diaphragm();
    if (i == lens.stop && !diaphragm)
      throw Error(ExitCode::unsupported,
                  fmt::format("{}: surfaces[{}]: pbrt's format holds no stop on a glass surface", lens.file, i));
    for (const std::size_t neighbour : {i - 1, i + 1}) {  // pbrt traces rays forward only
      if (!diaphragm || neighbour >= lens.surfaces.size()) continue;
      const double edge = std::min(s.semi_diameter_mm, lens.surfaces[neighbour].semi_diameter_mm);
      if (lens.gap_mm(std::min(i, neighbour), std::max(i, neighbour), edge) < 0)
        throw Error(ExitCode::unsupported,
                    fmt::format("{}: surfaces[{}]: pbrt traces no stop whose plane cuts surfaces[{}]", lens.file, i,
                                neighbour));
    }
    const double thickness = (i + 1 < lens.surfaces.size() ? lens.surfaces[i + 1].z_mm : film_z_mm) - s.z_mm;
    const double radius = diaphragm ? 0 : s.curvature == 0 ? kPlaneRadius : 1 / s.curvature;
    out += fmt::format("{:.9g} {:.9g} {:.9g} {:.9g}\n", radius, thickness, n[i], 2 * s.semi_diameter_mm);
  }
  return out;
}

}  // namespace pecs::lens
