// pecs board: targets to print: a checkerboard, a grid of circles, a disk of black and white sectors.
#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <memory>
#include <numbers>

#include "commands.h"
#include "pecs/error.h"
#include "pecs/run_record.h"
#include "picture_file.h"

namespace pecs::app {
namespace {

constexpr double kRulerMm = 100, kCaptionMm = 14;

struct Grid {
  int columns = 0, rows = 0;
};

Grid parse_grid(const std::string& option, const std::string& text) {
  Grid g;
  const char* end = text.data() + text.size();
  const auto [cross, first] = std::from_chars(text.data(), end, g.columns);
  const bool crossed = first == std::errc{} && cross != end && *cross == 'x';
  if (!crossed || std::from_chars(cross + 1, end, g.rows).ptr != end || g.columns < 2 || g.rows < 2 ||
      g.columns > 500 || g.rows > 500)
    throw Error(ExitCode::usage, fmt::format("{}: got '{}', wanted COLUMNSxROWS, 2 to 500 each", option, text));
  return g;
}

// A page in millimetres: `body` on white, and below it what it is and a ruler to check the printer's scale with.
std::string page(double width_mm, double height_mm, const std::string& body, const std::string& caption) {
  const double page_width = std::max(width_mm, kRulerMm + 10), page_height = height_mm + kCaptionMm;
  const double y = height_mm + 4;
  return fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0}mm\" height=\"{1}mm\" viewBox=\"0 0 {0} {1}\">\n"
      "<rect width=\"{0}\" height=\"{1}\" fill=\"white\"/>\n{2}"
      "<path d=\"M5 {3}v3M5 {4}h{5}M{6} {3}v3\" stroke=\"black\" stroke-width=\".2\" fill=\"none\"/>\n"
      "<text x=\"5\" y=\"{7}\" font-family=\"DejaVu Sans\" font-size=\"3\">{8}; the line is {5} mm "
      "long</text>\n</svg>\n",
      page_width, page_height, body, y, y + 1.5, kRulerMm, 5 + kRulerMm, y + 7, caption);
}

std::string checkerboard(Grid squares, double square_mm) {
  std::string path;
  for (int row = 0; row < squares.rows; ++row)
    for (int column = row % 2; column < squares.columns; column += 2)  // black top left
      path += fmt::format("M{} {}h{}v{}h-{}z", (column + 1) * square_mm, (row + 1) * square_mm, square_mm, square_mm,
                          square_mm);
  return page((squares.columns + 2) * square_mm, (squares.rows + 2) * square_mm,
              fmt::format("<path d=\"{}\" fill=\"black\"/>\n", path),
              fmt::format("{} x {} squares of {} mm ({} x {} inner corners)", squares.columns, squares.rows, square_mm,
                          squares.columns - 1, squares.rows - 1));
}

// As OpenCV counts: symmetrical, or with every other row half a spacing to the right and rows half a spacing apart.
std::string circles(Grid grid, double spacing_mm, bool asymmetric) {
  const double step = asymmetric ? spacing_mm / 2 : spacing_mm;
  std::string body;
  for (int row = 0; row < grid.rows; ++row)
    for (int column = 0; column < grid.columns; ++column) {
      const double x = spacing_mm * (column + 1) + (asymmetric && row % 2 ? step : 0);
      body += fmt::format("<circle cx=\"{}\" cy=\"{}\" r=\"{}\"/>\n", x, spacing_mm + step * row, spacing_mm / 5);
    }
  return page(spacing_mm * (grid.columns + (asymmetric ? 1.5 : 1)), 2 * spacing_mm + step * (grid.rows - 1), body,
              fmt::format("{} x {} circles{}, {} mm apart", grid.columns, grid.rows, asymmetric ? ", asymmetric" : "",
                          spacing_mm));
}

std::string disk(int sectors, double diameter_mm) {
  const double radius = diameter_mm / 2, centre = radius + 5;
  const auto at = [&](int edge) {
    const double angle = 2 * std::numbers::pi * edge / sectors;
    return fmt::format("{:.4f} {:.4f}", centre + radius * std::cos(angle), centre - radius * std::sin(angle));
  };
  std::string path;
  for (int k = 0; k < sectors; k += 2)  // counter-clockwise on paper
    path += fmt::format("M{0} {0}L{1}A{2} {2} 0 0 0 {3}z", centre, at(k), radius, at(k + 1));
  return page(2 * centre, 2 * centre,
              fmt::format("<path d=\"{0}\"/>\n<circle cx=\"{1}\" cy=\"{1}\" r=\"{2}\" fill=\"none\" "
                          "stroke=\"black\" stroke-width=\".2\"/>\n",
                          path, centre, radius),
              fmt::format("disk of {} sectors, {} mm across", sectors, diameter_mm));
}

}  // namespace

void add_board(CLI::App& app) {
  struct Options {
    std::string squares, circles, output;
    double square_mm = 25, spacing_mm = 25, diameter_mm = 0;
    int sectors = 4, width_px = 1920;
    bool asymmetric = false;
  };
  const auto o = std::make_shared<Options>();
  CLI::App* sub = app.add_subcommand("board", "a target to print: checkerboard, grid of circles, disk of sectors");
  auto* kind = sub->add_option_group("target");
  kind->add_option("--squares", o->squares, "checkerboard of COLUMNSxROWS squares, black at the top left");
  kind->add_option("--circles", o->circles, "grid of COLUMNSxROWS black circles");
  kind->add_option("--disk-mm", o->diameter_mm, "diameter of a disk")->check(CLI::Range(1.0, 10000.0));
  kind->require_option(1);
  sub->add_option("--square-mm", o->square_mm, "side of a square")
      ->check(CLI::Range(0.1, 1000.0))
      ->capture_default_str();
  sub->add_option("--spacing-mm", o->spacing_mm, "between circles of a row")
      ->check(CLI::Range(0.1, 1000.0))
      ->capture_default_str();
  sub->add_flag("--asymmetric", o->asymmetric, "every other row of circles half a spacing to the right");
  sub->add_option("--sectors", o->sectors, "of the disk, black and white ones in all; even")
      ->check(CLI::Range(2, 64))
      ->capture_default_str();
  sub->add_option("-o,--output", o->output, "the picture: .svg, .pdf or .png")->required();
  sub->add_option("--width-px", o->width_px, "width of a .png")->check(CLI::Range(16, 16384))->capture_default_str();
  sub->callback([o] {
    if (o->sectors % 2)
      throw Error(ExitCode::usage, fmt::format("--sectors: got {}, wanted an even number", o->sectors));
    const std::string svg = !o->squares.empty() ? checkerboard(parse_grid("--squares", o->squares), o->square_mm)
                            : !o->circles.empty()
                                ? circles(parse_grid("--circles", o->circles), o->spacing_mm, o->asymmetric)
                                : disk(o->sectors, o->diameter_mm);
    write_picture(o->output, svg, o->width_px);
    write_run_record(o->output, {.command = "board",
                                 .arguments = arguments(),
                                 .config = {{"squares", o->squares},
                                            {"square_mm", o->square_mm},
                                            {"circles", o->circles},
                                            {"spacing_mm", o->spacing_mm},
                                            {"asymmetric", o->asymmetric},
                                            {"disk_mm", o->diameter_mm},
                                            {"sectors", o->sectors}},
                                 .inputs = {},
                                 .results = Json::object()});
    fmt::print("{}: print it at 100 %, and measure the line\n", o->output);
  });
}

}  // namespace pecs::app
