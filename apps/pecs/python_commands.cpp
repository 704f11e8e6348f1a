// Commands that are Python modules of the package: `pecs dataset` knows recipes, Blender and the layouts of loaders;
// `pecs demo` is a script over the other commands.
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include "commands.h"
#include "pecs/error.h"

namespace pecs::app {
namespace {

// PECS_PYTHON, or that of the checkout or environment this program lies in, or the system's.
std::string python() {
  if (const char* named = std::getenv("PECS_PYTHON")) return named;
  std::error_code error;
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", error);
  for (std::filesystem::path folder = program.parent_path(); folder.has_relative_path(); folder = folder.parent_path())
    for (const char* own : {".venv/bin/python", "bin/python3"})
      if (std::filesystem::exists(folder / own, error)) return (folder / own).string();
  return "python3";
}

void add_module(CLI::App& app, const std::string& name, const std::string& module, const std::string& about) {
  CLI::App* sub = app.add_subcommand(name, about);
  sub->prefix_command();
  sub->set_help_flag();  // Python's
  sub->callback([sub, name, module] {
    const std::string program = python();
    std::vector<std::string> words = {program, "-m", module};
    const std::vector<std::string> given = sub->remaining();
    words.insert(words.end(), given.begin(), given.end());
    std::vector<char*> pointers;
    pointers.reserve(words.size() + 1);
    for (std::string& word : words) pointers.push_back(word.data());
    pointers.push_back(nullptr);
    execvp(program.c_str(), pointers.data());
    throw Error(ExitCode::not_found, fmt::format("{}: {}: {}; PECS_PYTHON names a Python that has pecs", name, program,
                                                 std::strerror(errno)));
  });
}

}  // namespace

void add_dataset(CLI::App& app) {
  add_module(app, "dataset", "pecs.datasets",
             "sequences with ground truth from a recipe, in the layouts of loaders (Python)");
}

void add_demo(CLI::App& app) {
  add_module(app, "demo", "pecs.demo", "a scene with a known truth as events, pictures, video and pages (Python)");
}

}  // namespace pecs::app
