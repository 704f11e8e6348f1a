#include "usage.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <numeric>
#include <vector>

#include "command_tree.h"
#include "pecs/error.h"

namespace pecs::app {
namespace {

// Levenshtein's distance.
std::size_t edits(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i + 1);
    for (std::size_t k = 0; k < b.size(); ++k) {
      const std::size_t replaced = diagonal + (a[i] != b[k]);
      diagonal = row[k + 1];
      row[k + 1] = std::min({replaced, row[k] + 1, diagonal + 1});
    }
  }
  return row.back();
}

std::vector<std::string> names_of_commands(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* command : commands_of(app)) names.push_back(command->get_name());
  return names;
}

const std::string& nearest(const std::string& word, const std::vector<std::string>& names) {
  return *std::min_element(names.begin(), names.end(),
                           [&](const auto& a, const auto& b) { return edits(word, a) < edits(word, b); });
}

// The message about the first word that is not an option of `app`, or an empty string.
std::string unknown_option(const CLI::App& app) {
  for (std::string word : app.remaining()) {
    if (!word.starts_with("--") || word == "--") continue;
    word = word.substr(0, word.find('='));
    std::vector<std::string> names;
    for (const CLI::Option* option : app.get_options())
      for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
    return fmt::format("{}: no such option; nearest: {}", word, nearest(word, names));
  }
  return "";
}

// "lens info: ", for what is below the program.
std::string prefix(const std::vector<std::string>& path) {
  return path.empty() ? "" : fmt::format("{}: ", fmt::join(path, " "));
}

}  // namespace

void check_commands(const CLI::App& app, int argc, const char* const* argv) {
  const CLI::App* at = &app;
  std::vector<std::string> path;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const std::vector<std::string> names = names_of_commands(*at);
    const bool takes_words = !at->get_options([](const CLI::Option* o) { return o->get_positional(); }).empty();
    if (names.empty() || word.starts_with('-')) return;
    if (std::find(names.begin(), names.end(), word) == names.end()) {
      if (takes_words) return;
      throw Error(ExitCode::usage,
                  fmt::format("{}{}: no such command; nearest: {}", prefix(path), word, nearest(word, names)));
    }
    at = at->get_subcommand(word);
    path.push_back(word);
  }
}

std::string usage_line(const CLI::App& app, const CLI::ParseError& error) {
  const CLI::App& at = chosen_below(app);
  const std::vector<std::string> path = path_of(at), names = names_of_commands(at);
  if (const std::string unknown = unknown_option(at); !unknown.empty()) return prefix(path) + unknown;
  std::string text = error.what();
  if (dynamic_cast<const CLI::RequiredError*>(&error) && at.get_require_subcommand_min() > 0 && !names.empty())
    text = fmt::format("got no command, wanted one of {}", fmt::join(names, ", "));
  std::replace(text.begin(), text.end(), '\n', ' ');
  return prefix(path) + text;
}

}  // namespace pecs::app
