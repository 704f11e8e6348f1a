#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <limits>

#include "commands.h"
#include "pecs/files.h"
#include "pecs/text.h"

namespace pecs::app {
namespace {

std::optional<double> number_of(const std::string& text) {
  return number_from<double>(std::string_view(text).substr(text.starts_with('+')));
}

// CLI11 accepts nan for any number, converts -1 to an unsigned one, and clamps integers that are too large.
std::string finite(const std::string& text) {
  const auto value = number_of(text);
  return value && !std::isfinite(*value) ? fmt::format("got {}, wanted a finite number", text) : "";
}

std::string not_negative(const std::string& text) {
  return text.starts_with('-') ? fmt::format("got {}, wanted 0 or more", text) : "";
}

template <class Integer>
std::string within(const std::string& text) {
  Integer value = 0;
  const auto [end, ec] = std::from_chars(text.data(), text.data() + text.size(), value);
  using Limits = std::numeric_limits<Integer>;
  if (ec != std::errc::result_out_of_range) return "";
  return fmt::format("got {}, wanted an integer in [{}, {}]", text, Limits::min(), Limits::max());
}

// Compares the outputs with all other values that are names of files.
void check_files(const CLI::App& app) {
  std::vector<std::filesystem::path> inputs, outputs;
  for (const CLI::Option* option : app.get_options()) {
    const bool writes = option->get_type_name() == kOutput;
    std::error_code ec;
    for (const std::string& value : option->results())
      if (writes || std::filesystem::exists(value, ec)) (writes ? outputs : inputs).emplace_back(value);
  }
  check_outputs(inputs, outputs);
}

}  // namespace

CLI::Validator positive() {
  return CLI::Validator(
      [](const std::string& text) {
        const auto value = number_of(text);
        const bool is_good = value && *value > 0 && std::isfinite(*value);
        return is_good ? "" : fmt::format("got {}, wanted a number above 0", text);
      },
      "POSITIVE");
}

void check_options(CLI::App& app) {
  for (CLI::Option* option : app.get_options()) {
    const std::string type = option->get_type_name();
    if (type.starts_with("FLOAT")) option->check(finite);
    if (type.starts_with("UINT")) option->check(not_negative)->check(within<std::uint64_t>);
    if (type.starts_with("INT")) option->check(within<std::int64_t>);
  }
  app.parse_complete_callback([&app] { check_files(app); });
  for (CLI::App* sub : app.get_subcommands({})) check_options(*sub);
}

}  // namespace pecs::app
