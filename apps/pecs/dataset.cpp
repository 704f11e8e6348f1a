// pecs dataset: `python -m pecs.datasets`, which knows recipes, Blender and the layouts of loaders.
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

// PECS_PYTHON, or that of the checkout this program was built in, or the system's.
std::string python() {
  if (const char* named = std::getenv("PECS_PYTHON")) return named;
  std::error_code error;
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", error);
  for (std::filesystem::path folder = program.parent_path(); folder.has_relative_path(); folder = folder.parent_path())
    if (const auto own = folder / ".venv/bin/python"; std::filesystem::exists(own, error)) return own.string();
  return "python3";
}

}  // namespace

void add_dataset(CLI::App& app) {
  CLI::App* sub =
      app.add_subcommand("dataset", "sequences with ground truth from a recipe, in the layouts of loaders (Python)");
  sub->prefix_command();
  sub->set_help_flag();  // Python's
  sub->callback([sub] {
    const std::string program = python();
    std::vector<std::string> words = {program, "-m", "pecs.datasets"};
    const std::vector<std::string> given = sub->remaining();
    words.insert(words.end(), given.begin(), given.end());
    std::vector<char*> pointers;
    pointers.reserve(words.size() + 1);
    for (std::string& word : words) pointers.push_back(word.data());
    pointers.push_back(nullptr);
    execvp(program.c_str(), pointers.data());
    throw Error(ExitCode::not_found, fmt::format("dataset: {}: {}; PECS_PYTHON names a Python that has pecs", program,
                                                 std::strerror(errno)));
  });
}

}  // namespace pecs::app
