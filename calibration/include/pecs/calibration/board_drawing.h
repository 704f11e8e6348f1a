#pragma once
// Targets to print, as SVG pages in millimetres, with a ruler that shows the printer's scale.
#include <string>

namespace pecs::calibration {

std::string draw_checkerboard(int columns, int rows, double square_mm);  // squares; black at the top left
// As OpenCV counts: symmetrical, or with every other row half a spacing to the right and rows half a spacing apart.
std::string draw_circles(int columns, int rows, double spacing_mm, bool asymmetric);
// sectors: number of black and white ones together; the first one, counter-clockwise from the right, is black.
std::string draw_disk(int sectors, double diameter_mm);

}  // namespace pecs::calibration
