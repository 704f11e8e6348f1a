#pragma once
// The program's commands and options as CLI11 has them, for what is generated from them.
#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace pecs::app {

// Those with a name, in the order of --help.
std::vector<const CLI::App*> commands_of(const CLI::App& app);

// {a,b} of an option's type, or nothing.
std::vector<std::string> choices_of(const CLI::Option& option);

// A text's first letter large, a full stop behind.
std::string sentence(std::string text);

// man(7) pages: pecs.1 in `folder`, and one for each command.
void write_man_pages(const CLI::App& app, const std::string& folder);

// What bash, zsh or fish reads to complete command lines.
std::string completion(const CLI::App& app, const std::string& shell);

}  // namespace pecs::app
