#pragma once
// Converts event keys to events. Compiled for each instruction set (unpack_kernel.cpp).
#include <span>

#include "pecs/events/event.h"
#include "pecs/sensor/event_slots.h"

namespace pecs::sensor {

// out: as many events as keys, of a picture of this width [1, kMaxSide].
void unpack_events(std::span<const EventKey> keys, int width, events::Event* out);

}  // namespace pecs::sensor
