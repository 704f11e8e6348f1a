#pragma once
// Event keys on their way to the sorter, by slots of time. A key is written once: a slot is a list of chunks, and all
// chunks are used again in the next batch.
#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "pecs/sensor/event_key.h"

namespace pecs::sensor {

class EventSlots {
 public:
  static constexpr std::size_t kChunk = 1024;  // keys

  EventSlots() { begin({}); }
  // Empties it. edges: rising; slot i begins at edges[i]. The first slot has what comes before it too.
  void begin(std::span<const EventKey> edges);
  std::size_t size() const { return edges_.size() - 1; }

  // Fast for events that come nearly by time.
  void add(EventKey key) {
    Slot& slot = slot_of(key);
    if (slot.next == slot.end) grow(slot);
    *slot.next++ = key;
  }
  // Where the slot ends in which a key lies.
  EventKey end_of_slot(EventKey key) {
    slot_of(key);
    return edges_[at_ + 1];
  }
  // Room for no more than kChunk keys of the slot in which `key` lies; they count at once.
  EventKey* room(std::size_t count, EventKey key);

  std::size_t count(std::size_t slot) const;
  // Appends where a slot's keys lie, in the order in which they came.
  void find(std::size_t slot, std::vector<std::span<const EventKey>>& parts) const;
  void clear(std::size_t slot);
  // Moves the keys from `limit` on to the end of `later`.
  void take_later(std::size_t slot, EventKey limit, std::vector<EventKey>& later);

 private:
  struct Chunk {
    EventKey* keys;
    std::size_t count;  // of the last chunk: see Slot::next
  };
  struct Slot {
    std::vector<Chunk> chunks;
    EventKey *next = nullptr, *end = nullptr;  // in the last chunk
  };
  static std::size_t count(const Slot& slot, const Chunk& chunk);
  Slot& slot_of(EventKey key) {
    while (key < edges_[at_]) --at_;
    while (key >= edges_[at_ + 1]) ++at_;
    return slots_[at_];
  }
  void grow(Slot& slot);

  std::vector<EventKey> edges_;
  std::vector<Slot> slots_;
  std::size_t at_ = 0;
  std::vector<EventKey*> spare_;  // chunks
  std::vector<std::unique_ptr<EventKey[]>> slabs_;
  std::size_t slab_ = 0;  // keys in the last of them
};

}  // namespace pecs::sensor
