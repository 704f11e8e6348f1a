#pragma once
// The earth mover's distance of two distributions on a line: the area between their cumulative distributions,
// integral |F_a(x) - F_b(x)| dx, in the unit of x. No circle: what lies beyond the ends does not come back.
#include <span>

namespace pecs::metrics {

// Histograms over the same bins; each counts as of area 1. Neither may be empty.
double earth_mover(std::span<const double> a, std::span<const double> b, double bin_width);

// Samples in rising order, at least one each.
double earth_mover_of_sorted(std::span<const float> a, std::span<const float> b);

}  // namespace pecs::metrics
