#include "pecs/sensor/named_spectrum.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <sstream>

#include "pecs/data_dir.h"
#include "pecs/error.h"
#include "pecs/files.h"

namespace pecs::sensor {
namespace {

constexpr double kC2_nm_k = 1.438776877e7;  // second radiation constant hc/k, CODATA 2018

double temperature_of(const std::string& kind, const std::string& text, double least_k, double most_k) {
  std::istringstream words(text);
  double t_k = 0;
  std::string more;
  if (!(words >> t_k) || words >> more || !(t_k >= least_k && t_k <= most_k))
    throw bad_input("spectrum", kind + ":T", text.empty() ? "nothing" : text,
                    fmt::format("a temperature in [{:g}, {:g}] K", least_k, most_k));
  return t_k;
}

// Planck, 100 at 560 nm (between the table's points).
Spectrum blackbody(double t_k) {
  Spectrum s;
  for (double nm = 300; nm <= 1100; nm += 5) {
    s.lambda_nm.push_back(nm);
    s.value.push_back(std::pow(nm, -5.0) / std::expm1(kC2_nm_k / (nm * t_k)));
  }
  const double at_560 = s.at(560);
  for (double& v : s.value) v *= 100 / at_560;
  return s;
}

// CIE 15:2018, Eqs. 4.6-4.10: chromaticity, then weights to three decimals.
Spectrum daylight(double t_k) {
  const double k1 = 1e3 / t_k, k2 = 1e6 / (t_k * t_k), k3 = 1e9 / (t_k * t_k * t_k);
  const double x = t_k <= 7000 ? -4.6070 * k3 + 2.9678 * k2 + 0.09911 * k1 + 0.244063
                               : -2.0064 * k3 + 1.9018 * k2 + 0.24748 * k1 + 0.237040;
  const double y = -3.000 * x * x + 2.870 * x - 0.275, m = 0.0241 + 0.2562 * x - 0.7341 * y;
  const auto rounded = [](double weight) { return std::nearbyint(weight * 1000) / 1000; };
  const double m1 = rounded((-1.3515 - 1.7703 * x + 5.9114 * y) / m);
  const double m2 = rounded((0.0300 - 31.4424 * x + 30.0717 * y) / m);
  Spectrum s;
  for (const auto& row : read_table(data_dir("lens_data/spectra") / "basis" / "daylight.csv", 4)) {
    s.lambda_nm.push_back(row[0]);
    s.value.push_back(std::max(row[1] + m1 * row[2] + m2 * row[3], 0.0));
  }
  return s;
}

std::filesystem::path file_of(const std::string& name_or_path) {
  if (name_or_path.find('.') != std::string::npos) return name_or_path;
  const std::filesystem::path folder = data_dir("lens_data/spectra");
  if (const auto path = folder / (name_or_path + ".csv"); std::filesystem::is_regular_file(path)) return path;
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    if (entry.path().extension() == ".csv") names.insert(entry.path().stem().string());
  throw not_found(name_or_path,
                  fmt::format("no file, and none of {}, blackbody:T, daylight:T", fmt::join(names, ", ")));
}

}  // namespace

std::vector<std::vector<double>> read_table(const std::filesystem::path& path, std::size_t columns) {
  std::istringstream lines(read_text(path, 1 << 20));
  std::vector<std::vector<double>> rows;
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number) {
    std::string text = line.substr(0, line.find('#'));
    std::replace(text.begin(), text.end(), ',', ' ');
    if (text.find_first_not_of(" \t\r") == std::string::npos || (rows.empty() && text.starts_with("wavelength_nm")))
      continue;
    std::istringstream words(text);
    std::vector<double> row(columns);
    std::string more;
    bool good = true;
    for (double& v : row) good = good && words >> v && std::isfinite(v);
    const std::string place = "line " + std::to_string(number);
    if (!good || words >> more)
      throw bad_input(path.string(), place, line.substr(0, 40),
                      fmt::format("{} numbers, wavelength in nm first", columns));
    if (!rows.empty() && row[0] <= rows.back()[0])
      throw bad_input(path.string(), place, fmt::format("{:g} nm after {:g} nm", row[0], rows.back()[0]),
                      "rising wavelengths");
    rows.push_back(row);
  }
  if (rows.size() < 2) throw bad_input(path.string(), "table", fmt::format("{} rows", rows.size()), "at least 2");
  return rows;
}

Spectrum named_spectrum(const std::string& name_or_path) {
  const auto colon = name_or_path.find(':');
  const std::string kind = name_or_path.substr(0, colon);
  if (colon != std::string::npos && kind == "blackbody")
    return blackbody(temperature_of(kind, name_or_path.substr(colon + 1), 500, 1e5));
  if (colon != std::string::npos && kind == "daylight")
    return daylight(temperature_of(kind, name_or_path.substr(colon + 1), 4000, 25000));
  const std::filesystem::path path = file_of(name_or_path);
  Spectrum s;
  for (const auto& row : read_table(path, 2)) {
    if (!(row[1] >= 0))
      throw bad_input(path.string(), fmt::format("{:g} nm", row[0]), fmt::format("{:g}", row[1]), ">= 0");
    s.lambda_nm.push_back(row[0]), s.value.push_back(row[1]);
  }
  return s;
}

}  // namespace pecs::sensor
