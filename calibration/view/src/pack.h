#pragma once
// Events for the pages of web/, 8 bytes each, little-endian: u32 microseconds from the first event; u16 x with the
// polarity in its top bit; u16 y.
#include <cstdint>
#include <vector>

#include "pecs/view/event_pictures.h"

namespace pecs::view {

// At most `limit` events, drawn at random. Throws unsupported for recordings above 71 minutes.
std::vector<std::uint8_t> packed_events(const events::Recording& recording, std::size_t limit);

}  // namespace pecs::view
