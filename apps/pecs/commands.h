#pragma once
// To add a subcommand: write <name>.cpp with `void add_<name>(CLI::App& app)` that adds it and sets its callback,
// declare it here, list it in main.cpp and CMakeLists.txt. Its help begins in lower case and ends with examples
// (help.h); numbers with a unit take it (units.h); warnings and run records go through Talk. A callback reports failure
// by throwing pecs::Error.
#include <CLI/CLI.hpp>

namespace pecs::app {

class Talk;  // talk.h

// The command line as given, for run records.
const std::vector<std::string>& arguments();

void add_align(CLI::App& app, Talk& talk);
void add_bands(CLI::App& app);
void add_board(CLI::App& app, Talk& talk);
void add_compare(CLI::App& app, Talk& talk);
void add_completion(CLI::App& app);
void add_convert(CLI::App& app, Talk& talk);
void add_dataset(CLI::App& app, Talk& talk);
void add_demo(CLI::App& app, Talk& talk);
void add_learning(CLI::App& app, Talk& talk);  // train, reconstruct
void add_info(CLI::App& app);
void add_man(CLI::App& app);
void add_render_preview(CLI::App& app, Talk& talk);
void add_report(CLI::App& app, Talk& talk);
void add_run(CLI::App& app, Talk& talk);
void add_sense(CLI::App& app, Talk& talk);
void add_version(CLI::App& app);  // --version
void add_view(CLI::App& app, Talk& talk);
void add_lens(CLI::App& app, Talk& talk);

// A number above 0 (CLI::PositiveNumber says so with the 309 digits of the largest one).
CLI::Validator positive();

// For every subcommand, after it is added: no option takes a number that is not finite, one beyond its integers, or a
// negative one where there are none; no output ("-o", "OUT", "--picture", "--labels") is an input or another output.
void check_options(CLI::App& app);

}  // namespace pecs::app
