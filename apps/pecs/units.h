#pragma once
// Option values with a unit: "20ms", "0.5 m", "10kHz". A plain number is in the option's own unit, which --help shows:
// TIME[us]. The commands in Python follow the same rule and read the same table, python/pecs/units.json.
#include <CLI/CLI.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "pecs/text.h"

namespace pecs::app {

// For transform() of an option for a number: converts its value to `unit`, a unit of units.json.
CLI::Validator quantity(const std::string& unit);

// Adds an option for a number in `unit`.
template <class Number>
CLI::Option* add_quantity(CLI::App& command, const std::string& name, Number& value, const std::string& unit,
                          const std::string& help) {
  return command.add_option(name, value, help)->transform(quantity(unit));
}

// All of "A:B:C", or nothing.
template <class Number>
std::optional<std::vector<Number>> numbers_of(std::string_view text, char between, std::size_t count) {
  std::vector<Number> out;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t end = std::min(text.find(between, begin), text.size());
    const auto number = number_from<Number>(text.substr(begin, end - begin));
    if (!number) return {};
    out.push_back(*number);
    begin = end + 1;
  }
  return out.size() == count ? std::optional(out) : std::nullopt;
}

}  // namespace pecs::app
