// pecs completion, pecs man: what shells and man(1) read, from the same commands and options as --help.
#include "command_tree.h"

#include <fmt/format.h>

#include <memory>

#include "commands.h"

namespace pecs::app {

std::vector<const CLI::App*> commands_of(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App* command) { return !command->get_name().empty(); });
}

std::vector<std::string> choices_of(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  const std::size_t open = type.find('{'), close = type.find('}');
  std::vector<std::string> words;
  if (open != std::string::npos && close != std::string::npos)
    words = CLI::detail::split(type.substr(open + 1, close - open - 1), ',');
  return words;
}

std::string sentence(std::string text) {
  if (text.empty()) return text;
  text.front() = static_cast<char>(std::toupper(static_cast<unsigned char>(text.front())));
  if (text.back() != '.') text += '.';
  return text;
}

void add_completion(CLI::App& app) {
  auto shell = std::make_shared<std::string>();
  CLI::App* sub =
      app.add_subcommand("completion", "what a shell reads to complete command lines: source <(pecs completion bash)");
  sub->add_option("SHELL", *shell, "bash, zsh or fish")->required()->check(CLI::IsMember({"bash", "zsh", "fish"}));
  sub->callback([&app, shell] { fmt::print("{}", completion(app, *shell)); });
}

void add_man(CLI::App& app) {
  auto folder = std::make_shared<std::string>();
  CLI::App* sub = app.add_subcommand("man", "the manual's pages: man -l FOLDER/pecs-sense.1");
  sub->add_option("-o,--output", *folder, "folder")->required();
  sub->callback([&app, folder] { write_man_pages(app, *folder); });
}

}  // namespace pecs::app
