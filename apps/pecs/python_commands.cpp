// Commands that are Python modules of the package: `pecs dataset` knows recipes, Blender and the layouts of loaders;
// `pecs demo` is a script over the other commands, `pecs run` renders a stack and hands it to `pecs sense`.
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include "commands.h"
#include "pecs/error.h"
#include "talk.h"

namespace pecs::app {
namespace {

// What the variable names, PECS_PYTHON, or that of the checkout or environment this program lies in, or the system's.
std::string python(const char* variable, const std::filesystem::path& program) {
  for (const char* name : {variable, "PECS_PYTHON"})
    if (const char* named = std::getenv(name)) return named;
  std::error_code error;
  for (std::filesystem::path folder = program.parent_path(); folder.has_relative_path(); folder = folder.parent_path())
    for (const char* own : {".venv/bin/python", "bin/python3"})
      if (std::filesystem::exists(folder / own, error)) return (folder / own).string();
  return "python3";
}

struct Module {
  std::vector<std::string> words;  // its name, and what comes before the command's own words
  const char* variable = "PECS_PYTHON";
};

// The module's process is told of this program.
void add_module(CLI::App& app, const Talk& talk, const std::string& name, const Module& module,
                const std::string& about) {
  CLI::App* sub = app.add_subcommand(name, about);
  sub->prefix_command();
  sub->set_help_flag();  // Python's
  sub->callback([sub, &talk, name, module] {
    std::error_code error;
    const std::filesystem::path self = std::filesystem::read_symlink("/proc/self/exe", error);
    if (!error) setenv("PECS_PROGRAM", self.c_str(), 0);
    const std::string program = python(module.variable, self);
    std::vector<std::string> words = {program, "-m"};
    words.insert(words.end(), module.words.begin(), module.words.end());
    if (talk.quiet()) words.emplace_back("--quiet");
    if (talk.verbose()) words.emplace_back("--verbose");
    const std::vector<std::string> given = sub->remaining();
    words.insert(words.end(), given.begin(), given.end());
    std::vector<char*> pointers;
    pointers.reserve(words.size() + 1);
    for (std::string& word : words) pointers.push_back(word.data());
    pointers.push_back(nullptr);
    execvp(program.c_str(), pointers.data());
    throw Error(ExitCode::not_found, fmt::format("{}: {}: {}; {} names a Python that has {}", name, program,
                                                 std::strerror(errno), module.variable, module.words.front()));
  });
}

}  // namespace

void add_dataset(CLI::App& app, Talk& talk) {
  add_module(app, talk, "dataset", {{"pecs.datasets"}},
             "sequences with ground truth from a recipe, in the layouts of loaders (Python)");
}

void add_demo(CLI::App& app, Talk& talk) {
  add_module(app, talk, "demo", {{"pecs.demo"}},
             "a scene with a known truth as events, pictures, video and pages (Python)");
}

void add_learning(CLI::App& app, Talk& talk) {
  add_module(app, talk, "train", {{"pecs.learning", "train"}},
             "a network that makes video of events, on a data set (Python)");
  add_module(app, talk, "reconstruct", {{"pecs.learning", "reconstruct"}},
             "video from events, by a network or a filter (Python)");
}

void add_run(CLI::App& app, Talk& talk) {
  add_module(app, talk, "run", {{"pecs_blender", "run"}, "PECS_BLENDER_PYTHON"},
             "a .blend or a scene folder to events: render, then sense (Python)");
}

}  // namespace pecs::app
