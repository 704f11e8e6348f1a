#pragma once
// Line plots as inline SVG for the report; colours come from the page's style sheet.
#include <string>
#include <vector>

namespace pecs::view {

struct Series {
  std::string name, style;  // style: class names of the page, e.g. "on real"
  std::vector<double> x, y;
  bool stems = false;  // vertical lines from zero instead of a curve
};

// y starts at zero. The names of the series are above the plot.
std::string line_plot(const std::vector<Series>& series, const std::string& x_label, const std::string& y_label);

}  // namespace pecs::view
