#include "usage.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <numeric>
#include <string_view>
#include <utility>

#include "pecs/error.h"

namespace pecs::app {
namespace {

// Levenshtein distance.
std::size_t edits(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (const char letter : a) {
    std::size_t diagonal = row[0]++;
    for (std::size_t k = 0; k < b.size(); ++k)
      diagonal = std::exchange(row[k + 1], std::min({diagonal + (letter != b[k]), row[k] + 1, row[k + 1] + 1}));
  }
  return row.back();
}

// Among equally near names, the one with the same first letter.
std::string nearest(const std::string& word, const std::vector<std::string>& names) {
  return *std::ranges::min_element(
      names, {}, [&](const std::string& name) { return std::pair(edits(word, name), name[0] != word[0]); });
}

std::vector<std::string> names_of_commands(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* command : commands_of(app)) names.push_back(command->get_name());
  return names;
}

// The error of the first unknown option of `app`, or of its first argument too many, or nothing.
std::string unknown_word(const CLI::App& app) {
  for (const std::string& word : app.remaining()) {
    if (!word.starts_with("--") || word == "--") continue;
    const std::string name = word.substr(0, word.find('='));
    std::vector<std::string> names;
    for (const CLI::Option* option : app.get_options())
      for (const std::string& known : option->get_lnames()) names.push_back("--" + known);
    return fmt::format("{}: no such option; nearest: {}", name, nearest(name, names));
  }
  if (app.remaining().empty()) return "";
  const std::string word = app.remaining().front();
  const bool is_value = app.get_option_no_throw("--set") && word.find('=') != word.npos;
  return fmt::format("{}: {}", word, is_value ? "each KEY=VALUE needs a --set" : "an argument too many");
}

// "lens info: "; nothing for the program.
std::string prefix(const CLI::App& command) {
  const std::string name = full_name(command);
  return name.empty() ? "" : name + ": ";
}

}  // namespace

std::vector<const CLI::App*> commands_of(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App* command) { return !command->get_name().empty(); });
}

const CLI::App& chosen_command(const CLI::App& app) {
  const auto chosen = app.get_subcommands();
  return chosen.empty() ? app : chosen_command(*chosen.front());
}

std::string full_name(const CLI::App& command) {
  if (!command.get_parent()) return "";
  const std::string above = full_name(*command.get_parent());
  return above.empty() ? command.get_name() : above + " " + command.get_name();
}

void check_commands(const CLI::App& app, const std::vector<std::string>& words) {
  const CLI::App* at = &app;
  for (const std::string& word : words) {
    const std::vector<std::string> names = names_of_commands(*at);
    if (names.empty() || word.starts_with('-')) return;
    if (std::ranges::find(names, word) == names.end()) {
      const bool takes_words = std::ranges::any_of(at->get_options(), &CLI::Option::get_positional);
      if (takes_words) return;
      throw Error(ExitCode::usage,
                  fmt::format("{}{}: no such command; nearest: {}", prefix(*at), word, nearest(word, names)));
    }
    at = at->get_subcommand(word);
  }
}

std::string usage_line(const CLI::App& app, const CLI::ParseError& error) {
  const CLI::App& command = chosen_command(app);
  std::string text = unknown_word(command);
  if (text.empty() && dynamic_cast<const CLI::RequiredError*>(&error) && command.get_require_subcommand_min() > 0)
    text = fmt::format("the command is missing; use one of {}", fmt::join(names_of_commands(command), ", "));
  if (text.empty()) text = error.what();
  // CLI11: a number with a decimal point or an exponent for an integer, "Could not convert: --t-start = 1e3".
  constexpr std::string_view kConversion = "Could not convert: ";
  if (const auto equals = text.find(" = "); text.starts_with(kConversion) && equals != std::string::npos)
    text = fmt::format("{}: got {}, wanted a whole number",
                       text.substr(kConversion.size(), equals - kConversion.size()), text.substr(equals + 3));
  if (const auto at = text.find(": At Most 1 required but received"); at != std::string::npos)
    text = text.substr(0, at) + ": is set twice; set it once";
  std::ranges::replace(text, '\n', ' ');
  return prefix(command) + text;
}

}  // namespace pecs::app
