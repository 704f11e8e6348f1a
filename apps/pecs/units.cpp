#include "units.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <span>

namespace pecs::app {
namespace {

struct Unit {
  const char* name;
  int exponent;  // of ten, beside the kind's SI unit
};

struct Kind {
  const char *name, *example;
  std::vector<Unit> units;
};

constexpr double kLongest_us = 1e15;  // 31 years; every us up to here is a double

std::span<const Kind> kinds() {
  static const std::vector<Kind> all = {
      {"TIME", "20ms", {{"ns", -9}, {"us", -6}, {"µs", -6}, {"μs", -6}, {"ms", -3}, {"s", 0}}},
      {"LENGTH", "5mm", {{"nm", -9}, {"um", -6}, {"µm", -6}, {"μm", -6}, {"mm", -3}, {"cm", -2}, {"m", 0}}},
      {"FREQUENCY", "10kHz", {{"Hz", 0}, {"kHz", 3}, {"MHz", 6}, {"fps", 0}}},
      {"CURRENT",
       "2pA",
       {{"fA", -15}, {"pA", -12}, {"nA", -9}, {"uA", -6}, {"µA", -6}, {"μA", -6}, {"mA", -3}, {"A", 0}}},
      {"ANGLE", "1.5deg", {{"deg", 0}}},
      {"PIXELS", "24px", {{"px", 0}}},
      {"STOPS", "2EV", {{"EV", 0}}},
      {"LIGHT", "500lx", {{"lx", 0}, {"klx", 3}}},
      {"MEMORY", "2GB", {{"MB", 6}, {"GB", 9}}},
  };
  return all;
}

const Unit* find(const Kind& kind, std::string_view name) {
  const auto at = std::ranges::find(kind.units, name, &Unit::name);
  return at == kind.units.end() ? nullptr : &*at;
}

std::string wanted(const Kind& kind, const std::string& own) {
  std::vector<std::string> names;
  for (const Unit& unit : kind.units)
    if (static_cast<unsigned char>(unit.name[0]) < 0x80) names.emplace_back(unit.name);
  return fmt::format("wanted a number with a unit ({}) such as {}, or in {} without", fmt::join(names, ", "),
                     kind.example, own);
}

// `text` becomes a plain number; returns what is wrong.
std::string convert(std::string& text, const Kind& kind, const Unit& own) {
  double value = 0;
  const char *begin = text.data() + (text.starts_with('+') && !text.starts_with("+-")),
             *end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(begin, end, value);
  std::string_view rest(stop, end);
  while (rest.starts_with(' ')) rest.remove_prefix(1);
  const Unit* unit = rest.empty() ? &own : find(kind, rest);
  if (error != std::errc() || !unit || (!rest.empty() && !std::isfinite(value)))
    return fmt::format("got '{}', {}", text, wanted(kind, own.name));
  const int shift = unit->exponent - own.exponent;  // powers of ten up to 22 are exact
  const double own_value = shift < 0 ? value / std::pow(10, -shift) : value * std::pow(10, shift);
  if (std::string_view(own.name) == "us" && std::abs(own_value) > kLongest_us)
    return fmt::format("got '{}', wanted a time of at most {:g}us", text, kLongest_us);
  if (!rest.empty()) text = fmt::format("{:.15g}", own_value);  // 1.1ms are 1100 us
  return {};
}

}  // namespace

CLI::Validator quantity(const std::string& unit) {
  for (const Kind& kind : kinds())
    if (const Unit* own = find(kind, unit))
      return CLI::Validator([&kind, own](std::string& text) { return convert(text, kind, *own); },
                            fmt::format("{}[{}]", kind.name, unit));
  throw std::logic_error("quantity: no unit " + unit);
}

}  // namespace pecs::app
