#include "pecs/calibration/board_drawing.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace pecs::calibration {
namespace {

constexpr double kRulerMm = 100, kCaptionMm = 14;

// A page in millimetres: `body` on white, below it its name and a ruler that shows the printer's scale.
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

}  // namespace

std::string draw_checkerboard(int columns, int rows, double square_mm) {
  std::string path;
  for (int row = 0; row < rows; ++row)
    for (int column = row % 2; column < columns; column += 2)  // black top left
      path += fmt::format("M{} {}h{}v{}h-{}z", (column + 1) * square_mm, (row + 1) * square_mm, square_mm, square_mm,
                          square_mm);
  return page(
      (columns + 2) * square_mm, (rows + 2) * square_mm, fmt::format("<path d=\"{}\" fill=\"black\"/>\n", path),
      fmt::format("{} x {} squares of {} mm ({} x {} inner corners)", columns, rows, square_mm, columns - 1, rows - 1));
}

std::string draw_circles(int columns, int rows, double spacing_mm, bool asymmetric) {
  const double step = asymmetric ? spacing_mm / 2 : spacing_mm;
  std::string body;
  for (int row = 0; row < rows; ++row)
    for (int column = 0; column < columns; ++column) {
      const double x = spacing_mm * (column + 1) + (asymmetric && row % 2 ? step : 0);
      body += fmt::format("<circle cx=\"{}\" cy=\"{}\" r=\"{}\"/>\n", x, spacing_mm + step * row, spacing_mm / 5);
    }
  return page(
      spacing_mm * (columns + (asymmetric ? 1.5 : 1)), 2 * spacing_mm + step * (rows - 1), body,
      fmt::format("{} x {} circles{}, {} mm apart", columns, rows, asymmetric ? ", asymmetric" : "", spacing_mm));
}

std::string draw_disk(int sectors, double diameter_mm) {
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

}  // namespace pecs::calibration
