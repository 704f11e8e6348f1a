#pragma once
// What --help says, in the form of Python's argparse, so that all commands look alike; examples at its end.
#include <CLI/CLI.hpp>
#include <initializer_list>
#include <string>

namespace pecs::app {

// Below a command's --help, one per line. To be called once for every command (tests/python/cli/test_cli.py).
void add_examples(CLI::App& command, std::initializer_list<const char*> lines);

// For `app` and every command below it.
void format_help(CLI::App& app);

}  // namespace pecs::app
