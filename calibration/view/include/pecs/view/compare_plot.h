#pragma once
#include <string>

#include "pecs/metrics/compare.h"

namespace pecs::view {

// Line plots (SVG) in the colours of the page they stand on: event rates over time (`alone`: of one stream, which was
// compared with itself); histograms of the delays.
std::string rate_plot(const metrics::Comparison& comparison, bool alone = false);
std::string delay_plot(const metrics::DelayComparison& delays);

// Both as a drawing of its own.
std::string compare_picture(const metrics::Comparison& comparison);

}  // namespace pecs::view
