#include "units.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>

#include "units_table.h"

namespace pecs::app {
namespace {

using Table = nlohmann::ordered_json;  // kind of quantity -> {"example", "exponents": unit -> power of ten in SI units}

constexpr double kLongest_us = 1e15;  // 31 years; every us up to here is a double

std::string wanted(const Table& kind, const std::string& own) {
  std::vector<std::string> names;
  for (const auto& [name, exponent] : kind["exponents"].items())
    if (static_cast<unsigned char>(name[0]) < 0x80) names.push_back(name);
  return fmt::format("wanted a number with a unit ({}) such as {}, or in {} without", fmt::join(names, ", "),
                     kind["example"].get<std::string>(), own);
}

// Replaces `text` by the plain number in the unit `own`; returns the error, or nothing.
std::string convert(std::string& text, const Table& kind, const std::string& own) {
  double value = 0;
  const char *begin = text.data() + (text.starts_with('+') && !text.starts_with("+-")),
             *end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(begin, end, value);
  std::string unit(stop, end);
  unit.erase(0, unit.find_first_not_of(' '));
  const Table& exponents = kind["exponents"];
  if (error != std::errc() || !(unit.empty() || exponents.contains(unit)) || (!unit.empty() && !std::isfinite(value)))
    return fmt::format("got '{}', {}", text, wanted(kind, own));
  const int shift = exponents.value(unit, exponents[own].get<int>()) - exponents[own].get<int>();
  const double own_value = shift < 0 ? value / std::pow(10, -shift) : value * std::pow(10, shift);  // exact up to 1e22
  if (own == "us" && std::abs(own_value) > kLongest_us)
    return fmt::format("got '{}', wanted a time of at most {:g}us", text, kLongest_us);
  if (!unit.empty()) text = fmt::format("{:.15g}", own_value);  // 1.1ms are 1100 us
  return {};
}

}  // namespace

CLI::Validator quantity(const std::string& unit) {
  static const Table kTable = Table::parse(kUnitsTable);
  for (auto kind = kTable.begin(); kind != kTable.end(); ++kind)
    if ((*kind)["exponents"].contains(unit))
      return CLI::Validator([kind, unit](std::string& text) { return convert(text, *kind, unit); },
                            fmt::format("{}[{}]", kind.key(), unit));
  throw std::logic_error("quantity: no unit " + unit);
}

}  // namespace pecs::app
