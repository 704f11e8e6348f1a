#pragma once
// What is said about a wrong command line: one line, `pecs: COMMAND: …`.
#include <CLI/CLI.hpp>
#include <string>

namespace pecs::app {

// Throws Error(usage) for a word where a command is wanted and none has that name; also with --help behind.
void check_commands(const CLI::App& app, int argc, const char* const* argv);

// The line for an error of the parser, without "pecs: ".
std::string usage_line(const CLI::App& app, const CLI::ParseError& error);

}  // namespace pecs::app
