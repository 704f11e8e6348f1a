#pragma once
#include <string>

#include "pecs/events/format.h"

namespace pecs::calibration {

// Unwraps timestamps from a counter of 2^k us (`note` then reports it). Throws bad_input for timestamps that decrease
// otherwise; a decrease of less than 10 ms is kept.
events::Stream unwrap_timestamps(events::Stream stream, const std::string& file, std::string& note);

}  // namespace pecs::calibration
