#pragma once
// Option values with a unit ("300us", "1.5 ms"): the unit is required, so that no one guesses it.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdlib>
#include <map>
#include <string>

namespace pecs::app {

// A time for a variable of type double, in microseconds.
inline CLI::Validator time_us() {
  return CLI::Validator(
      [](std::string& text) -> std::string {
        static const std::map<std::string, double> units = {{"ns", 1e-3}, {"us", 1}, {"ms", 1e3}, {"s", 1e6}};
        char* end = nullptr;
        const double number = std::strtod(text.c_str(), &end);
        while (*end == ' ') ++end;
        const auto unit = units.find(end);
        if (end == text.c_str() || unit == units.end() || !std::isfinite(number))
          return fmt::format("got '{}', wanted a time with its unit (ns, us, ms, s), such as 20ms", text);
        text = fmt::format("{:.17g}", number * unit->second);
        return {};
      },
      "TIME[ns,us,ms,s]");
}

}  // namespace pecs::app
