#pragma once
// The program's commands and options as CLI11 has them, for what is generated from them.
#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace pecs::app {

// Those with a name, in the order of --help.
std::vector<const CLI::App*> commands_of(const CLI::App& app);

// The command that the words chose, `app` itself where they chose none.
const CLI::App& chosen_below(const CLI::App& app);

// "lens", "info": from the program down to `command`.
std::vector<std::string> path_of(const CLI::App& command);

// "-o", "--output": as they are shown. Further long names are those of before, which are taken and not shown.
std::vector<std::string> names_of(const CLI::Option& option);

// {a,b} of an option's type, or nothing.
std::vector<std::string> choices_of(const CLI::Option& option);

// "us" of an option with quantity("us"), or nothing.
std::string unit_of(const CLI::Option& option);

// "TEXT", "TIME[us]", or nothing of a flag.
std::string value_of(const CLI::Option& option);

// "-o, --output TEXT", "--start TIME[us]".
std::string heading_of(const CLI::Option& option);

// What it does, with its range and default.
std::string said_of(const CLI::Option& option);

// A text's first letter large, a full stop behind.
std::string sentence(std::string text);

// man(7) pages: pecs.1 in `folder`, and one for each command.
void write_man_pages(const CLI::App& app, const std::string& folder);

// What bash, zsh or fish reads to complete command lines.
std::string completion(const CLI::App& app, const std::string& shell);

}  // namespace pecs::app
