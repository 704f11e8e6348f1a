#pragma once
#include <string>

#include "pecs/events/format.h"

namespace pecs::calibration {

// A recording whose clock goes on: a counter of 2^k us that starts again is continued (`note` says so). Throws
// bad_input where time goes back for no such reason. Disorder of less than 10 ms is left as it is.
events::Stream with_steady_clock(events::Stream stream, const std::string& file, std::string& note);

}  // namespace pecs::calibration
