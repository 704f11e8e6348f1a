// pecs board: draws targets to print: a checkerboard, a grid of circles, a disk of black and white sectors.
#include <fmt/format.h>

#include <memory>

#include "commands.h"
#include "console.h"
#include "help.h"
#include "pecs/calibration/board_drawing.h"
#include "pecs/error.h"
#include "pecs/text.h"
#include "picture_file.h"
#include "units.h"

namespace pecs::app {
namespace {

struct Grid {
  int columns = 0, rows = 0;
};

Grid parse_grid(const std::string& option, const std::string& text) {
  const std::size_t cross = std::min(text.find('x'), text.size() - 1);
  const Grid g{number_from<int>(text.substr(0, cross)).value_or(0),
               number_from<int>(text.substr(cross + 1)).value_or(0)};
  if (g.columns < 2 || g.rows < 2 || g.columns > 500 || g.rows > 500)
    throw Error(ExitCode::usage, fmt::format("{}: got '{}', wanted COLUMNSxROWS, 2 to 500 each", option, text));
  return g;
}

}  // namespace

void add_board(CLI::App& app, Console& console) {
  struct Options {
    std::string squares, circles, output;
    double square_mm = 25, spacing_mm = 25, diameter_mm = 0;
    int sectors = 4, width_px = 1920;
    bool asymmetric = false;
  };
  const auto o = std::make_shared<Options>();
  CLI::App* sub = app.add_subcommand("board", "a target to print: checkerboard, grid of circles, disk of sectors");
  sub->add_option("--squares", o->squares, "checkerboard of COLUMNSxROWS squares, black at the top left");
  sub->add_option("--circles", o->circles, "grid of COLUMNSxROWS black circles");
  add_quantity(*sub, "--disk", o->diameter_mm, "mm", "diameter of a disk")->check(CLI::Range(1.0, 10000.0));
  add_quantity(*sub, "--square", o->square_mm, "mm", "side of a square")
      ->check(CLI::Range(0.1, 1000.0))
      ->capture_default_str();
  add_quantity(*sub, "--spacing", o->spacing_mm, "mm", "distance of the circles in a row")
      ->check(CLI::Range(0.1, 1000.0))
      ->capture_default_str();
  sub->add_flag("--asymmetric", o->asymmetric, "every other row of circles half a spacing to the right");
  sub->add_option("--sectors", o->sectors, "number of sectors of the disk, black and white together; even")
      ->check(CLI::Range(2, 64))
      ->capture_default_str();
  add_output(*sub, "-o,--output", o->output, "picture: .svg, .pdf or .png")->required();
  add_quantity(*sub, "--width", o->width_px, "px", "width of a .png")
      ->check(CLI::Range(16, 16384))
      ->capture_default_str();
  add_examples(*sub, {"pecs board --squares 9x6 --square 25mm -o board.pdf",
                      "pecs board --circles 11x4 --asymmetric -o circles.svg",
                      "pecs board --disk 80mm --sectors 4 -o disk.svg"});
  sub->callback([o, &console] {
    if (!o->squares.empty() + !o->circles.empty() + (o->diameter_mm > 0) != 1)
      throw Error(ExitCode::usage, "board: requires one of --squares, --circles and --disk");
    if (o->sectors % 2) throw bad_usage("--sectors", std::to_string(o->sectors), "an even number");
    const auto squares = [&] {
      const Grid g = parse_grid("--squares", o->squares);
      return calibration::draw_checkerboard(g.columns, g.rows, o->square_mm);
    };
    const auto circles = [&] {
      const Grid g = parse_grid("--circles", o->circles);
      return calibration::draw_circles(g.columns, g.rows, o->spacing_mm, o->asymmetric);
    };
    const std::string svg = !o->squares.empty()   ? squares()
                            : !o->circles.empty() ? circles()
                                                  : calibration::draw_disk(o->sectors, o->diameter_mm);
    write_picture(o->output, svg, o->width_px);
    console.record(o->output, {.command = "board",
                               .config = {{"squares", o->squares},
                                          {"square_mm", o->square_mm},
                                          {"circles", o->circles},
                                          {"spacing_mm", o->spacing_mm},
                                          {"asymmetric", o->asymmetric},
                                          {"disk_mm", o->diameter_mm},
                                          {"sectors", o->sectors}}});
    fmt::print("{}: print it at 100 % and measure the ruler\n", o->output);
  });
}

}  // namespace pecs::app
