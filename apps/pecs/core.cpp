// Replaces the files that need OpenCV in a build with PECS_CORE.
#include "commands.h"
#include "pecs/error.h"

namespace pecs::app {
namespace {

void add_missing(CLI::App& app, const char* name) {
  CLI::App* sub = app.add_subcommand(name, "not in this build, the core of PECS");
  sub->prefix_command();
  sub->set_help_flag();
  sub->callback([name] { throw not_in_core(name); });
}

}  // namespace

void add_align(CLI::App& app, Console&) { add_missing(app, "align"); }
void add_board(CLI::App& app, Console&) { add_missing(app, "board"); }
void add_render_preview(CLI::App& app, Console&) { add_missing(app, "render-preview"); }
void add_report(CLI::App& app, Console&) { add_missing(app, "report"); }
void add_video(CLI::App& app, Console&) { add_missing(app, "video"); }
void add_view(CLI::App& app, Console&) { add_missing(app, "view"); }

Json found_disk(const events::Stream&, const std::string&) { throw not_in_core("--disk find"); }

}  // namespace pecs::app
