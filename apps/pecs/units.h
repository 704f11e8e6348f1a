#pragma once
// Option values with a unit ("300us", "1.5 ms"): the unit is required, so that no one guesses it.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdlib>
#include <map>
#include <string>

namespace pecs::app {

constexpr double kLongest_us = 1e15;  // 31 years; every us up to here is a double

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
        const double time = number * unit->second;
        if (std::abs(time) > kLongest_us)
          return fmt::format("got '{}', wanted a time of at most {:g}us", text, kLongest_us);
        text = fmt::format("{:.17g}", time);
        return {};
      },
      "TIME[ns,us,ms,s]");
}

}  // namespace pecs::app
