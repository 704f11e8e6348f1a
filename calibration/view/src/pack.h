#pragma once
// Events for the pages of calibration/view/web/: 8 bytes each, little-endian: u32 microseconds from the first event;
// u16 x, its top bit the polarity; u16 y.
#include <cstdint>
#include <vector>

#include "pecs/view/event_pictures.h"

namespace pecs::view {

// Above `limit` events that many, drawn at random. Throws unsupported for recordings above 71 minutes.
std::vector<std::uint8_t> packed_events(const events::Recording& recording, std::size_t limit);

}  // namespace pecs::view
