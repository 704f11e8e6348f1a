#include <fmt/format.h>

#include "commands.h"
#include "console.h"
#include "help.h"
#include "pecs/error.h"
#include "pecs/platform.h"
#include "pecs/program.h"
#include "usage.h"

namespace pecs::app {
namespace {

int run(const std::vector<std::string>& words) {
  CLI::App app{"PECS: a physically based event-camera simulator", "pecs"};
  app.require_subcommand(1);
  add_examples(app, {"pecs demo                                    # a scene with ground truth",
                     "pecs sense out/stack -o events.raw           # a rendered stack to events",
                     "pecs view events.raw -o events.png           # and a picture of them",
                     "pecs --version --verbose                     # for a bug report"});
  add_version(app);
  Console console(words);
#define PECS_ADD(name) add_##name(app, console);
  PECS_COMMANDS(PECS_ADD)
#undef PECS_ADD
  console.add_to(app);
  check_options(app);
  format_help(app);
  try {
    check_commands(app, words);
    app.parse(std::vector<std::string>(words.rbegin(), words.rend()));  // CLI11 takes the last word first
    console.end(app);
  } catch (const CLI::Success& e) {  // --help, --version
    return app.exit(e);
  } catch (const CLI::ParseError& e) {
    throw Error(ExitCode::usage, usage_line(app, e));
  }
  return 0;
}

}  // namespace

}  // namespace pecs::app

int main(int argc, char** argv) {
  return pecs::run_program("pecs", [&] { return pecs::app::run(pecs::platform::arguments(argc, argv)); });
}
