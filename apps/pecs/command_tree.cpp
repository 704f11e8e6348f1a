// pecs completion, pecs man: what shells and man(1) read, from the same commands and options as --help.
#include "command_tree.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <memory>
#include <regex>

#include "commands.h"
#include "help.h"

namespace pecs::app {
namespace {

// The first group of `pattern` in an option's type, whose parts CLI11 joins: "FLOAT:TIME[us]:POSITIVE".
std::string in_type(const CLI::Option& option, const char* pattern) {
  const std::string type = option.get_type_name();
  std::smatch found;
  return std::regex_search(type, found, std::regex(pattern)) ? found[1].str() : "";
}

}  // namespace

std::string value_of(const CLI::Option& option) {
  if (option.get_items_expected_max() == 0) return "";
  if (const auto quantity = in_type(option, R"(:([A-Z]+\[\w+\]))"); !quantity.empty()) return quantity;
  if (const auto form = in_type(option, "^TEXT:(.+)$"); !form.empty()) return form;
  const std::string type = in_type(option, "^([A-Z]+)");
  const std::string word = type == "FLOAT" ? "NUMBER" : type == "INT" || type == "UINT" ? "N" : type;
  return option.get_items_expected_max() == 2 ? word + " " + word : word;
}

std::vector<const CLI::App*> commands_of(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App* command) { return !command->get_name().empty(); });
}

const CLI::App& chosen_below(const CLI::App& app) {
  const CLI::App* at = &app;
  for (auto chosen = at->get_subcommands(); !chosen.empty(); chosen = at->get_subcommands()) at = chosen.front();
  return *at;
}

std::vector<std::string> path_of(const CLI::App& command) {
  std::vector<std::string> path;
  for (const CLI::App* at = &command; at->get_parent(); at = at->get_parent())
    path.insert(path.begin(), at->get_name());
  return path;
}

std::vector<std::string> names_of(const CLI::Option& option) {
  std::vector<std::string> names;
  for (const std::string& name : option.get_snames()) names.push_back("-" + name);
  if (!option.get_lnames().empty()) names.push_back("--" + option.get_lnames().front());
  return names;
}

std::vector<std::string> choices_of(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  const std::size_t open = type.find('{'), close = type.find('}');
  std::vector<std::string> words;
  if (open != std::string::npos && close != std::string::npos)
    words = CLI::detail::split(type.substr(open + 1, close - open - 1), ',');
  return words;
}

std::string unit_of(const CLI::Option& option) { return in_type(option, R"(:[A-Z]+\[(\w+)\])"); }

std::string heading_of(const CLI::Option& option) {
  if (option.get_positional()) return option.get_name();
  const std::string value = value_of(option);
  return fmt::format("{}{}{}", fmt::join(names_of(option), ", "), value.empty() ? "" : " ", value);
}

std::string said_of(const CLI::Option& option) {
  std::vector<std::string> more;
  const std::string low = in_type(option, R"(in \[(\S+) - )"), high = in_type(option, R"(in \[\S+ - (\S+)\])");
  if (!low.empty() && high.size() <= 6) more.push_back(low + " to " + high);
  std::string usual = option.get_default_str();
  if (usual.starts_with('[') && usual.ends_with(']')) usual = usual.substr(1, usual.size() - 2);
  if (!usual.empty()) more.push_back("default: " + usual + unit_of(option));
  if (option.get_required() && !option.get_positional()) more.emplace_back("required");
  return option.get_description() + (more.empty() ? "" : fmt::format(" ({})", fmt::join(more, "; ")));
}

std::string sentence(std::string text) {
  if (text.empty()) return text;
  text.front() = static_cast<char>(std::toupper(static_cast<unsigned char>(text.front())));
  if (text.back() != '.') text += '.';
  return text;
}

void add_completion(CLI::App& app) {
  auto shell = std::make_shared<std::string>();
  CLI::App* sub = app.add_subcommand("completion", "what a shell reads to complete command lines");
  sub->add_option("SHELL", *shell, "bash, zsh or fish")->required()->check(CLI::IsMember({"bash", "zsh", "fish"}));
  add_examples(*sub, {"source <(pecs completion bash)", "pecs completion fish > ~/.config/fish/completions/pecs.fish"});
  sub->callback([&app, shell] { fmt::print("{}", completion(app, *shell)); });
}

void add_man(CLI::App& app) {
  auto folder = std::make_shared<std::string>();
  CLI::App* sub = app.add_subcommand("man", "the manual's pages, for man(1)");
  sub->add_option("-o,--output", *folder, "folder")->required();
  add_examples(*sub, {"pecs man -o out/man      # then: man -l out/man/pecs-sense.1"});
  sub->callback([&app, folder] { write_man_pages(app, *folder); });
}

}  // namespace pecs::app
