#pragma once
// Events on their way from a pixel to the sorter: keys, by slots of time.
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace pecs::sensor {

// Cause of an event: the largest contribution to the change of V from the reference to the threshold.
// `frame`: exposures of the chip's own frames. Found after sorting: `render`, the renderer's noise, and `unsure`, light
// whose motion between frames is a guess.
enum class Cause : std::uint8_t { signal, leak, noise, hot, render, unsure, frame };

// An event as a number, ordered as events are: time in us (34 bits, 4.7 hours), then pixel (y * width + x, 26 bits),
// then polarity, then cause (`signal` if causes are not reported).
using EventKey = std::uint64_t;
inline constexpr double kMostTime_us = 1.7e10;  // of 1.718e10: events may be later than the last frame
inline constexpr int kKeyTimeShift = 30, kKeyPixelShift = 4, kKeyOnShift = 3;
inline EventKey event_key(std::int64_t t_us, std::uint32_t pixel, bool on, Cause cause = Cause::signal) {
  return static_cast<std::uint64_t>(t_us) << kKeyTimeShift | std::uint64_t{pixel} << kKeyPixelShift |
         std::uint64_t{on} << kKeyOnShift | static_cast<std::uint64_t>(cause);
}
inline std::int64_t key_time_us(EventKey key) { return static_cast<std::int64_t>(key >> kKeyTimeShift); }
inline std::uint32_t key_pixel(EventKey key) { return static_cast<std::uint32_t>(key >> kKeyPixelShift) & 0x3ffffff; }
inline bool key_on(EventKey key) { return key >> kKeyOnShift & 1; }
inline Cause key_cause(EventKey key) { return static_cast<Cause>(key & 7); }

// A key is written once: a slot is a list of chunks, and all chunks are used again in the next batch.
class EventSlots {
 public:
  static constexpr std::size_t kChunk = 1024;  // keys

  EventSlots() { begin({}); }
  // Empties all slots. Slot i begins at edges[i], increasing; the first one also holds earlier keys.
  void begin(std::span<const EventKey> edges);
  std::size_t size() const { return edges_.size() - 1; }

  // Fastest for keys nearly sorted by time.
  void add(EventKey key) {
    Slot& slot = slot_of(key);
    if (slot.next == slot.end) grow(slot);
    *slot.next++ = key;
  }
  // End of the slot of a key.
  EventKey end_of_slot(EventKey key) {
    slot_of(key);
    return edges_[at_ + 1];
  }
  // Room for up to kChunk keys in the slot of `key`; they are counted as added.
  EventKey* room(std::size_t count, EventKey key);

  std::size_t count(std::size_t slot) const;
  // Appends spans of a slot's keys, in the order in which they were added.
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
