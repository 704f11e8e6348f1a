#pragma once
// ECF, the event compression of Metavision HDF5 files (HDF5 filter 0x8ECF). A block, little-endian:
//   u32  number of events << 2 | style; style bit 1: y, x, p packed together; else bit 0: x, p packed together
//   u64  t of the first event, then its times as runs, one byte each: high nibble dt (0..14), low nibble count; count
//        15 means that a u16 count follows; dt 15 means that the low nibble is 4 bits of a longer step, least first,
//        continued in the next byte (the step is added at the next byte with another high nibble)
//   style 2: four events in three u32, 24 bits each, y << 12 | x << 1 | p
//   else  y as runs, u16: y << 5 | count; count 31 means that a u16 count follows; then
//     style 1: four events in three u16, 12 bits each, x << 1 | p
//     style 0: x as u16, x << 5 | mask: x itself, and x + 1 + k for every bit 4 - k of the mask; then p as runs, u8,
//              p << 7 | count; count 127 means that a u16 count follows
// The last group of four and the last mask may contain more than the number of events; readers ignore the rest.
#include <span>
#include <string>
#include <vector>

#include "pecs/events/event.h"

namespace pecs::events::ecf {

constexpr int kFilter = 0x8ECF;

struct Damage {
  std::size_t offset;  // in the block
  std::string got, wanted;
};

constexpr std::size_t kMaxEvents = 65535;  // in a block

// Throws Damage. `max_events` bounds what is allocated.
void decode(std::span<const std::byte> block, std::size_t max_events, std::vector<Event>& out);

// Appends the block of at most kMaxEvents events with increasing timestamps and x, y below 2048, in the shortest style.
void encode(std::span<const Event> events, std::vector<std::byte>& out);

}  // namespace pecs::events::ecf
