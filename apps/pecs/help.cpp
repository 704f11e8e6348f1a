#include "help.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <sstream>

#include "command_tree.h"

namespace pecs::app {
namespace {

constexpr const char* kUnits = "Values may carry a unit (20ms, 0.5m); a plain number is in the unit in brackets.";
constexpr std::size_t kColumn = 28;  // where what an option does begins; as in python/pecs/_arguments.py

// As Python finds it: $COLUMNS, or the terminal's, or 80; two are left free.
std::size_t width() {
  int columns = 0;
  if (const char* given = std::getenv("COLUMNS")) columns = std::atoi(given);
  struct winsize size{};
  if (columns <= 0 && ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0) columns = size.ws_col;
  return static_cast<std::size_t>(std::clamp(columns > 0 ? columns : 80, 60, 120) - 2);
}

// Lines of at most width() characters, all but the first behind `indent` spaces; line ends of `text` are kept.
std::string wrapped(const std::string& text, std::size_t indent) {
  std::string out;
  std::istringstream lines(text);
  for (std::string line, word; std::getline(lines, line);) {
    if (!out.empty()) out += "\n" + std::string(indent, ' ');
    std::size_t used = indent;
    std::istringstream words(line);
    for (bool first = true; words >> word; first = false) {
      if (!first && used + 1 + word.size() > width()) {
        out += "\n" + std::string(indent, ' ') + word;
        used = indent + word.size();
        continue;
      }
      out += (first ? "" : " ") + word;
      used += word.size() + (first ? 0 : 1);
    }
  }
  return out;
}

std::string row(const std::string& name, const std::string& text) {
  std::string out = "  " + name;
  if (text.empty()) return out + "\n";
  const bool fits = out.size() + 2 <= kColumn;
  out += fits ? std::string(kColumn - out.size(), ' ') : "\n" + std::string(kColumn, ' ');
  return out + wrapped(text, kColumn) + "\n";
}

class Formatter : public CLI::Formatter {
 public:
  std::string make_help(const CLI::App* app, std::string name, CLI::AppFormatMode) const override {
    std::string usage = "usage: " + name + " [options]", out, options;
    bool has_units = false;
    for (const CLI::Option* option : app->get_options()) {
      if (!option->get_positional()) {
        options += row(heading_of(*option), said_of(*option));
        has_units = has_units || !unit_of(*option).empty();
        continue;
      }
      const std::string words = option->get_name() + (option->get_items_expected_max() > 1 ? " ..." : "");
      usage += option->get_required() ? " " + words : " [" + words + "]";
      out += row(option->get_name(), said_of(*option));
    }
    if (!out.empty()) out = "\narguments:\n" + out;
    if (!options.empty()) out += "\noptions:\n" + options;
    if (const auto below = commands_of(*app); !below.empty()) {
      usage += app->get_require_subcommand_min() ? " COMMAND ..." : " [COMMAND ...]";
      out += "\ncommands:\n";
      for (const CLI::App* command : below) out += row(command->get_name(), command->get_description());
    }
    if (has_units) out += fmt::format("\n{}\n", wrapped(kUnits, 0));
    if (!app->get_footer().empty()) out += "\n" + app->get_footer() + "\n";
    return usage + "\n\n" + wrapped(app->get_description(), 0) + "\n" + out;
  }
};

}  // namespace

void add_examples(CLI::App& command, std::initializer_list<const char*> lines) {
  command.footer(fmt::format("examples:\n  {}", fmt::join(lines, "\n  ")));
}

void format_help(CLI::App& app) {
  app.formatter(std::make_shared<Formatter>());
  if (CLI::Option* help = app.get_help_ptr()) help->description("show this help message and exit");
  for (CLI::App* command : app.get_subcommands({})) format_help(*command);
}

}  // namespace pecs::app
