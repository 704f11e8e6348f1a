#pragma once
#include <string>

#include "pecs/events/recording.h"
#include "pecs/metrics/compare.h"

namespace pecs::view {

// Plots as nodes of a page (page.h): event rates over time, of both streams or of one; histograms of the delays.
Json rate_plot(const metrics::Comparison& comparison);
Json rate_plot(const events::Recording& recording);
Json delay_plot(const metrics::DelayComparison& delays);

// Both as one SVG file.
std::string compare_picture(const metrics::Comparison& comparison);

}  // namespace pecs::view
