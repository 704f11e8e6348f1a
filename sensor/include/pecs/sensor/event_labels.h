#pragma once
// What the pixel of an event saw at the event's own time: numbers of a stack's layer (object ids), carried along the
// stack's motion.
#include <span>
#include <string>

#include "pecs/events/event.h"
#include "pecs/sensor/stack.h"

namespace pecs::sensor {

// out: a number of each event; 0 before the stack's first instant and after its last one. The layer has one channel of
// whole numbers, 0 to 65535, per instant (NaN is 0); the stack needs no light. The ids within an interval are those of
// so many instants that nothing moves more than half a pixel from one to the next (motion.h says which point counts).
// Events in the order of time; begin_us: their time at the stack's first instant. Throws bad_input for another layer,
// no motion, events that are not in order, and pixels outside. In the caller's TBB arena.
void event_labels(std::span<const events::Event> events, const StackReader& stack, const std::string& layer,
                  double begin_us, std::span<std::uint16_t> out);

}  // namespace pecs::sensor
