#pragma once
// Labels of events: the object (id in a layer of a stack) that an event's pixel saw at the event's time, from the layer
// warped along the stack's motion.
#include <span>
#include <string>

#include "pecs/events/event.h"
#include "pecs/sensor/stack.h"

namespace pecs::sensor {

// out: a label for each event; 0 before the stack's first frame and after its last one; with a period, the stack
// repeats. The layer has one channel of
// integers, 0 to 65535, per frame (NaN is 0); the stack needs no light. An event gets the label at the nearest of so
// many instants that nothing moves more than half a pixel from one to the next (motion.h: which point is visible).
// Events are sorted by time; begin_us: their time at the stack's first frame. Throws bad_input for another kind of
// layer, a stack without motion, unsorted events, and pixels outside the picture. In the caller's TBB arena.
void event_labels(std::span<const events::Event> events, const StackReader& stack, const std::string& layer,
                  double begin_us, std::span<std::uint16_t> out);

}  // namespace pecs::sensor
