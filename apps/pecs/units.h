#pragma once
// Option values with a unit ("300us", "1.5 ms"): the unit is required, so that no one guesses it.
#include <CLI/CLI.hpp>
#include <map>
#include <string>

namespace pecs::app {

// A time for a variable of type double, in microseconds.
inline CLI::AsNumberWithUnit time_us() {
  const std::map<std::string, double> units = {{"ns", 1e-3}, {"us", 1}, {"ms", 1e3}, {"s", 1e6}};
  return CLI::AsNumberWithUnit(units, CLI::AsNumberWithUnit::UNIT_REQUIRED, "TIME[ns,us,ms,s]");
}

}  // namespace pecs::app
