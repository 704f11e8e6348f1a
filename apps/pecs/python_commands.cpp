// Commands that are Python modules: this program replaces itself by Python with the rest of the command line.
#include <fmt/format.h>

#include <filesystem>

#include "commands.h"
#include "console.h"
#include "pecs/error.h"
#include "pecs/platform.h"

namespace pecs::app {
namespace {

// To add a command in Python: one line here, and its page in docs/reference and mkdocs.yml.
struct PythonCommand {
  const char* name;
  std::vector<std::string> words;  // the module, and what precedes the command's own words
  const char* help;
  const char* variable = "PECS_PYTHON";  // names the Python that has the module
};
const PythonCommand kCommands[] = {
    {"dataset", {"pecs.datasets"}, "sequences with ground truth from a recipe, in the layouts of loaders (Python)"},
    {"demo", {"pecs.demo"}, "a scene with ground truth as events, pictures, video and pages (Python)"},
    {"fit", {"pecs.fit"}, "fit a chip profile to recordings of a camera (Python)"},
    {"stimulus", {"pecs.fit.page"}, "a page that plays levels of light on a screen, for fit (Python)"},
    {"train", {"pecs.learning", "train"}, "train a network on a data set to reconstruct video from events (Python)"},
    {"reconstruct", {"pecs.learning", "reconstruct"}, "video from events, by a network or a filter (Python)"},
    {"run",
     {"pecs_blender", "run"},
     "a .blend or a scene folder to events: render, then sense (Python)",
     "PECS_BLENDER_PYTHON"},
};

}  // namespace

std::string python(const char* variable) {
  for (const char* name : {variable, "PECS_PYTHON"})
    if (const auto named = platform::environment(name)) return *named;
  std::error_code error;
  for (std::filesystem::path folder = platform::own_program().parent_path(); folder.has_relative_path();
       folder = folder.parent_path())
    for (const std::string& own : platform::python_places())
      if (std::filesystem::exists(folder / own, error)) return (folder / own).string();
  return std::filesystem::path(platform::python_places().back()).stem().string();
}

void become_python(const std::string& command, std::vector<std::string> words, const char* variable) {
  const std::filesystem::path self = platform::own_program();
  if (!self.empty() && !platform::environment("PECS_PROGRAM")) platform::set_environment("PECS_PROGRAM", self.string());
  const std::string program = python(variable), module = words.front();
  words.insert(words.begin(), {program, "-m", "pecs._command"});
  const std::string why = platform::become(program, std::move(words));
  throw Error(ExitCode::not_found,
              fmt::format("{}: {}: {}; set {} to a Python that has {}", command, program, why, variable, module));
}

void add_python(CLI::App& app, Console& console) {
  for (const PythonCommand& command : kCommands) {
    CLI::App* sub = app.add_subcommand(command.name, command.help);
    sub->prefix_command();
    sub->set_help_flag();  // Python's
    sub->callback([sub, &console, &command] {
      std::vector<std::string> words = command.words;
      if (console.quiet()) words.emplace_back("--quiet");
      if (console.verbose()) words.emplace_back("--verbose");
      const std::vector<std::string> more = sub->remaining();
      words.insert(words.end(), more.begin(), more.end());
      become_python(command.name, std::move(words), command.variable);
    });
  }
}

}  // namespace pecs::app
