#include <fmt/format.h>

#include <string>
#include <vector>

#include "commands.h"
#include "help.h"
#include "pecs/error.h"
#include "pecs/program.h"
#include "talk.h"
#include "usage.h"

namespace pecs::app {
namespace {

std::vector<std::string>& stored_arguments() {
  static std::vector<std::string> args;
  return args;
}

}  // namespace

const std::vector<std::string>& arguments() { return stored_arguments(); }
}  // namespace pecs::app

int main(int argc, char** argv) {
  return pecs::run_program("pecs", [&] {
    pecs::app::stored_arguments().assign(argv + 1, argv + argc);
    CLI::App app{"PECS: a physically based event-camera simulator", "pecs"};
    app.require_subcommand(1);
    pecs::app::Talk talk;
    pecs::app::add_examples(app, {"pecs demo                                    # a scene with a known truth",
                                  "pecs sense out/stack -o events.raw           # a rendered stack to events",
                                  "pecs view events.raw -o events.png           # and what they look like",
                                  "pecs --version --verbose                     # for a report of an error"});
    pecs::app::add_version(app);
    pecs::app::add_align(app, talk);
    pecs::app::add_bands(app);
    pecs::app::add_board(app, talk);
    pecs::app::add_compare(app, talk);
    pecs::app::add_convert(app, talk);
    pecs::app::add_dataset(app, talk);
    pecs::app::add_demo(app, talk);
    pecs::app::add_learning(app, talk);
    pecs::app::add_info(app);
    pecs::app::add_render_preview(app, talk);
    pecs::app::add_report(app, talk);
    pecs::app::add_run(app, talk);
    pecs::app::add_sense(app, talk);
    pecs::app::add_view(app, talk);
    pecs::app::add_lens(app, talk);
    pecs::app::add_completion(app);
    pecs::app::add_man(app);
    talk.add_to(app);
    pecs::app::check_options(app);
    pecs::app::format_help(app);
    try {
      pecs::app::check_commands(app, argc, argv);
      app.parse(argc, argv);
      talk.end(app);
    } catch (const CLI::Success& e) {  // --help, --version
      return app.exit(e);
    } catch (const CLI::ParseError& e) {
      throw pecs::Error(pecs::ExitCode::usage, pecs::app::usage_line(app, e));
    }
    return 0;
  });
}
