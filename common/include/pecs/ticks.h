#pragma once
// Round numbers on the axes of plots.
#include <vector>

namespace pecs {

// About `wanted` multiples of 1, 2 or 5 times a power of ten in [low, high].
std::vector<double> ticks(double low, double high, int wanted);

}  // namespace pecs
