#pragma once
// --help in the form that the commands in Python have too (python/pecs/_arguments.py), with examples at the end.
#include <CLI/CLI.hpp>
#include <initializer_list>
#include <string>

namespace pecs::app {

// Sets the examples at the end of --help, one per line. Every command has some (tests/python/cli/test_cli.py).
void add_examples(CLI::App& command, std::initializer_list<const char*> lines);

// Sets the form of --help for `app` and every command below it.
void format_help(CLI::App& app);

// "us" for an option with quantity("us"), otherwise nothing.
std::string unit_of(const CLI::Option& option);

}  // namespace pecs::app
