#pragma once
// Option values with a unit: "20ms", "0.5 m", "10kHz". A plain number is in the option's own unit, which --help names:
// TIME[us]. The same rule for commands in Python: python/pecs/_arguments.py.
#include <CLI/CLI.hpp>
#include <string>

namespace pecs::app {

// For options of numbers, with transform(): the value in `unit`, one of the units that units.cpp knows.
CLI::Validator quantity(const std::string& unit);

}  // namespace pecs::app
