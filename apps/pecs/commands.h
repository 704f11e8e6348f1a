#pragma once
// To add a subcommand: write <name>.cpp with `void add_<name>(CLI::App& app, Console& console)` that adds it and sets
// its callback; add its name to PECS_COMMANDS and its file to CMakeLists.txt; write its page in docs/reference and name
// the page in mkdocs.yml. The help of command and options begins in lower case and ends with examples (help.h).
// Numbers with a unit are added by add_quantity() (units.h), files to write by add_output(); warnings and run records
// go through Console. A callback reports failure by throwing pecs::Error.
#include <CLI/CLI.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "pecs/events/recording.h"
#include "pecs/sensor/pixel_model.h"

// In the order of --help.
#define PECS_COMMANDS(X) \
  X(align)               \
  X(bands)               \
  X(board) X(chip) X(compare) X(convert) X(info) X(lens) X(render_preview) X(report) X(sense) X(video) X(view) X(python)

namespace pecs::app {

class Console;  // console.h

#define PECS_DECLARE(name) void add_##name(CLI::App& app, Console& console);
PECS_COMMANDS(PECS_DECLARE)
#undef PECS_DECLARE

void add_version(CLI::App& app);  // --version

// The Python that PECS_PYTHON names, that of the checkout or environment that contains this program, or the system's.
// variable: one that precedes PECS_PYTHON.
std::string python(const char* variable = "PECS_PYTHON");
// Replaces this process by that Python with a module and its words; the module finds this program by PECS_PROGRAM.
[[noreturn]] void become_python(const std::string& command, std::vector<std::string> words,
                                const char* variable = "PECS_PYTHON");
// FILE.py of a model FILE.py:NAME; nothing for another name.
std::optional<std::string> python_file(const std::string& model);
// Runs FILE.py. Throws what is wrong with it.
std::shared_ptr<const sensor::UserModelEntry> python_model(const std::string& model, bool verbose);

// A result of --json.
void print_json(const Json& json, int indent = -1);

// The turning disk of a recording, as `pecs align detect --json` prints it.
Json found_disk(const events::Stream& recording, const std::string& file);

// An option or positional for the path of a file to write; check_options knows it by this type.
inline constexpr const char* kOutput = "OUTPUT";
template <class Path>
CLI::Option* add_output(CLI::App& command, const std::string& name, Path& path, const std::string& help) {
  return command.add_option(name, path, help)->type_name(kOutput);
}

// A number above 0 (CLI::PositiveNumber prints the 309 digits of the largest one).
CLI::Validator positive();

// For `app` and every command below it, after all options are added: rejects numbers that are not finite, that exceed
// their integer type or are negative for an unsigned one, and outputs that are an input or another output.
void check_options(CLI::App& app);

}  // namespace pecs::app
