#pragma once
#include <string>

#include "pecs/events/recording.h"
#include "pecs/metrics/compare.h"

namespace pecs::view {

// Line plots (SVG) in the colours of the page that contains them: event rates over time, of both streams or of one;
// histograms of the delays.
std::string rate_plot(const metrics::Comparison& comparison);
std::string rate_plot(const events::Recording& recording);
std::string delay_plot(const metrics::DelayComparison& delays);

// Both as one SVG file.
std::string compare_picture(const metrics::Comparison& comparison);

}  // namespace pecs::view
