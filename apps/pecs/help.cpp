#include "help.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <memory>
#include <sstream>

#include "usage.h"

namespace pecs::app {
namespace {

constexpr const char* kUnits = "Values may carry a unit (20ms, 0.5m); a plain number is in the unit in brackets.";
constexpr std::size_t kColumn = 28, kWidth = 80;  // of the descriptions; of the page

// Wraps `text` at kWidth; lines after the first one are indented. Line ends in `text` are kept.
std::string wrapped(const std::string& text, std::size_t indent) {
  const std::string line_end = "\n" + std::string(indent, ' ');
  std::string out;
  std::istringstream lines(text);
  for (std::string line, word; std::getline(lines, line);) {
    if (!out.empty()) out += line_end;
    std::size_t column = indent;
    std::istringstream words(line);
    while (words >> word) {
      const bool first = column == indent, fits = column + 1 + word.size() < kWidth;
      out += (first ? "" : fits ? " " : line_end) + word;
      column = (fits ? column + !first : indent) + word.size();
    }
  }
  return out;
}

std::string row(const std::string& name, const std::string& text) {
  const std::string out = "  " + name;
  if (text.empty()) return out + "\n";
  const bool fits = out.size() + 2 <= kColumn;
  return out + (fits ? "" : "\n") + std::string(kColumn - (fits ? out.size() : 0), ' ') + wrapped(text, kColumn) + "\n";
}

// CLI11's text for an option's type: the type, then the descriptions of its validators ("FLOAT:TIME[us]:POSITIVE").
std::vector<std::string> type_parts(const CLI::Option& option) {
  std::vector<std::string> parts;
  std::istringstream text(option.get_type_name());
  for (std::string part; std::getline(text, part, ':');) parts.push_back(part);
  return parts;
}

// "TIME[us]" for an option with quantity("us"), otherwise nothing.
std::string quantity_of(const CLI::Option& option) {
  for (const std::string& part : type_parts(option))
    if (part.ends_with(']') && part.find(' ') == part.npos) return part;
  return "";
}

// "TIME[us]", "{a,b}", "TEXT", "NUMBER NUMBER", or nothing for a flag.
std::string value_of(const CLI::Option& option) {
  if (option.get_items_expected_max() == 0) return "";
  if (const std::string quantity = quantity_of(option); !quantity.empty()) return quantity;
  const std::vector<std::string> parts = type_parts(option);
  if (parts.back().starts_with('{')) return parts.back();
  const std::string& type = parts.front();
  const std::string word = type == "FLOAT" ? "NUMBER" : type == "INT" || type == "UINT" ? "N" : type;
  return option.get_items_expected_max() == 2 ? word + " " + word : word;
}

// "-o, --output TEXT", "--start TIME[us]".
std::string heading_of(const CLI::Option& option) {
  if (option.get_positional()) return option.get_name();
  std::vector<std::string> names;
  for (const std::string& name : option.get_snames()) names.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) names.push_back("--" + name);
  const std::string value = value_of(option);
  return fmt::format("{}{}{}", fmt::join(names, ", "), value.empty() ? "" : " ", value);
}

// The description, with range and default.
std::string description_of(const CLI::Option& option) {
  std::vector<std::string> more;
  for (const std::string& part : type_parts(option))
    if (const auto at = part.find(" in ["); at != part.npos) {  // CLI::Range: "INT in [1 - 100]"
      std::string range = part.substr(at + 5, part.size() - at - 6);
      if (range.size() <= 12) more.push_back(range.replace(range.find(" - "), 3, " to "));
    }
  std::string usual = option.get_default_str();
  if (usual.starts_with('[') && usual.ends_with(']')) usual = usual.substr(1, usual.size() - 2);
  if (!usual.empty()) more.push_back("default: " + usual + unit_of(option));
  if (option.get_required() && !option.get_positional()) more.emplace_back("required");
  return option.get_description() + (more.empty() ? "" : fmt::format(" ({})", fmt::join(more, "; ")));
}

class Formatter : public CLI::Formatter {
 public:
  std::string make_help(const CLI::App* app, std::string name, CLI::AppFormatMode) const override {
    std::string usage = "usage: " + name + " [options]", arguments, options, commands;
    bool has_units = false;
    for (const CLI::Option* option : app->get_options()) {
      has_units = has_units || !quantity_of(*option).empty();
      (option->get_positional() ? arguments : options) += row(heading_of(*option), description_of(*option));
      if (!option->get_positional()) continue;
      const std::string words = option->get_name() + (option->get_items_expected_max() > 1 ? " ..." : "");
      usage += option->get_required() ? " " + words : " [" + words + "]";
    }
    for (const CLI::App* command : commands_of(*app)) commands += row(command->get_name(), command->get_description());
    if (!commands.empty()) usage += app->get_require_subcommand_min() ? " COMMAND ..." : " [COMMAND ...]";
    std::string out = usage + "\n\n" + wrapped(app->get_description(), 0) + "\n";
    for (const auto& [title, rows] : {std::pair{"arguments", arguments}, {"options", options}, {"commands", commands}})
      if (!rows.empty()) out += fmt::format("\n{}:\n{}", title, rows);
    if (has_units) out += fmt::format("\n{}\n", wrapped(kUnits, 0));
    return out + (app->get_footer().empty() ? "" : "\n" + app->get_footer() + "\n");
  }
};

}  // namespace

std::string unit_of(const CLI::Option& option) {
  const std::string quantity = quantity_of(option);
  const std::size_t open = quantity.find('[');
  return quantity.empty() ? "" : quantity.substr(open + 1, quantity.size() - open - 2);
}

void add_examples(CLI::App& command, std::initializer_list<const char*> lines) {
  command.footer(fmt::format("examples:\n  {}", fmt::join(lines, "\n  ")));
}

void format_help(CLI::App& app) {
  app.formatter(std::make_shared<Formatter>());
  if (CLI::Option* help = app.get_help_ptr()) help->description("show this help message and exit");
  for (CLI::App* command : app.get_subcommands({})) format_help(*command);
}

}  // namespace pecs::app
