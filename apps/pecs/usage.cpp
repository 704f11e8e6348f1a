#include "usage.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <numeric>
#include <regex>
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

// CLI11's texts in the form of all others.
std::string got_and_wanted(const CLI::App& command, const std::string& text) {
  static const std::regex kConversion("Could not convert: (\\S+) = (.*)"), kTwice("(\\S+): At Most 1 required .*"),
      kRange("(\\S+): Value (.*) not in range (.*?)(\\.0+)? to (.*?)(\\.0+)?"),
      kChoice("(\\S+): (.*) not in \\{(.*)\\}");
  std::smatch m;
  const auto number = [&](const std::string& name) {
    const CLI::Option* option = command.get_option_no_throw(name);
    return option && option->get_type_name().starts_with("FLOAT") ? "a number" : "a whole number";
  };
  if (std::regex_match(text, m, kConversion))
    return fmt::format("{}: got {}, wanted {}", m.str(1), m.str(2), number(m.str(1)));
  if (std::regex_match(text, m, kRange))
    return fmt::format("{}: got {}, wanted {} from {} to {}", m.str(1), m.str(2), number(m.str(1)), m.str(3), m.str(5));
  if (std::regex_match(text, m, kChoice))
    return fmt::format("{}: got {}, wanted {}", m.str(1), m.str(2),
                       std::regex_replace(m.str(3), std::regex(","), " or "));
  if (std::regex_match(text, m, kTwice)) return m.str(1) + ": is set twice; set it once";
  return text;
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
  text = got_and_wanted(command, text);
  std::ranges::replace(text, '\n', ' ');
  return prefix(command) + text;
}

}  // namespace pecs::app
