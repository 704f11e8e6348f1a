// CLI11 takes nan for any number, and -1 for an unsigned one: neither is an option's value here.
#include <fmt/format.h>

#include <cmath>

#include "commands.h"

namespace pecs::app {
namespace {

std::string finite(const std::string& text) {
  double value = 0;
  const bool odd = CLI::detail::lexical_cast(text, value) && !std::isfinite(value);
  return odd ? fmt::format("got {}, wanted a finite number", text) : "";
}

std::string not_negative(const std::string& text) {
  return text.starts_with('-') ? fmt::format("got {}, wanted 0 or more", text) : "";
}

}  // namespace

void check_numbers(CLI::App& app) {
  for (CLI::Option* option : app.get_options()) {
    const std::string type = option->get_type_name();
    if (type.starts_with("FLOAT")) option->check(finite);
    if (type.starts_with("UINT")) option->check(not_negative);
  }
  for (CLI::App* sub : app.get_subcommands({})) check_numbers(*sub);
}

}  // namespace pecs::app
