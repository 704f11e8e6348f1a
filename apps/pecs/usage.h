#pragma once
// Errors of the command line, each on one line: `pecs: COMMAND: …`.
#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace pecs::app {

// The subcommands of `app`, in the order of --help.
std::vector<const CLI::App*> commands_of(const CLI::App& app);

// The subcommand that was parsed, or `app`.
const CLI::App& chosen_command(const CLI::App& app);

// "lens info"; empty for the program.
std::string full_name(const CLI::App& command);

// Throws Error(usage) for an unknown subcommand, also where --help follows it.
void check_commands(const CLI::App& app, const std::vector<std::string>& words);

// The message for an error of the parser.
std::string usage_line(const CLI::App& app, const CLI::ParseError& error);

}  // namespace pecs::app
