#pragma once
// Option values with a unit: "20ms", "0.5 m", "10kHz". A plain number is in the option's own unit, which --help shows:
// TIME[us]. The commands in Python follow the same rule and read the same table, python/pecs/units.json.
#include <CLI/CLI.hpp>
#include <string>

namespace pecs::app {

// For transform() of an option for a number: converts its value to `unit`, a unit of units.json.
CLI::Validator quantity(const std::string& unit);

}  // namespace pecs::app
