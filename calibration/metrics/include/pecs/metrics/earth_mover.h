#pragma once
// The earth mover's distance of two distributions on a line: the area between their cumulative distributions,
// integral |F_a(x) - F_b(x)| dx, in the unit of x. The line is not periodic.
#include <span>

namespace pecs::metrics {

// For histograms over the same bins, normalised to area 1. Neither may be empty.
double earth_mover(std::span<const double> a, std::span<const double> b, double bin_width);

// For samples in increasing order, at least one each.
double earth_mover_of_sorted(std::span<const float> a, std::span<const float> b);

}  // namespace pecs::metrics
