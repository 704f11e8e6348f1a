#pragma once
// The bands for a chip and a lamp, from options as users give them.
#include "pecs/strict_json.h"

namespace pecs::sensor {

// Options and result as documented for pecs_bands in python/c/include/pecs.h.
Json choose_bands(const Json& options);

}  // namespace pecs::sensor
