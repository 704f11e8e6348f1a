#include "pecs/sensor/event_slots.h"

#include <algorithm>

#include "huge_pages.h"

namespace pecs::sensor {
namespace {

constexpr std::size_t kLeastSlab = std::size_t{8} << 10, kMostSlab = std::size_t{2} << 20;  // keys

}  // namespace

void EventSlots::begin(std::span<const EventKey> edges) {
  for (std::size_t i = 0; i < slots_.size(); ++i) clear(i);
  edges_.assign(edges.begin(), edges.end());
  if (edges_.empty()) edges_.push_back(0);
  edges_.front() = 0;
  edges_.push_back(~EventKey{0});
  if (slots_.size() < size()) slots_.resize(size());
  at_ = 0;
}

void EventSlots::grow(Slot& slot) {
  if (spare_.empty()) {
    slab_ = std::clamp(2 * slab_, kLeastSlab, kMostSlab);
    slabs_.push_back(std::make_unique_for_overwrite<EventKey[]>(slab_));
    ask_for_huge_pages(slabs_.back().get(), slab_ * sizeof(EventKey));
    for (std::size_t i = slab_; i > 0; i -= kChunk) spare_.push_back(slabs_.back().get() + i - kChunk);
  }
  if (!slot.chunks.empty()) slot.chunks.back().count = count(slot, slot.chunks.back());
  slot.next = spare_.back();
  slot.end = slot.next + kChunk;
  slot.chunks.push_back({slot.next, 0});
  spare_.pop_back();
}

EventKey* EventSlots::room(std::size_t count, EventKey key) {
  Slot& slot = slot_of(key);
  if (static_cast<std::size_t>(slot.end - slot.next) < count) grow(slot);
  EventKey* const room = slot.next;
  slot.next += count;
  return room;
}

std::size_t EventSlots::count(const Slot& slot, const Chunk& chunk) {
  return &chunk == &slot.chunks.back() ? static_cast<std::size_t>(slot.next - chunk.keys) : chunk.count;
}

std::size_t EventSlots::count(std::size_t slot) const {
  std::size_t sum = 0;
  for (const Chunk& chunk : slots_[slot].chunks) sum += count(slots_[slot], chunk);
  return sum;
}

void EventSlots::find(std::size_t slot, std::vector<std::span<const EventKey>>& parts) const {
  for (const Chunk& chunk : slots_[slot].chunks) parts.emplace_back(chunk.keys, count(slots_[slot], chunk));
}

void EventSlots::clear(std::size_t slot) {
  Slot& s = slots_[slot];
  for (const Chunk& chunk : s.chunks) spare_.push_back(chunk.keys);
  s.chunks.clear();
  s.next = s.end = nullptr;
}

void EventSlots::take_later(std::size_t slot, EventKey limit, std::vector<EventKey>& later) {
  Slot& s = slots_[slot];
  for (Chunk& chunk : s.chunks) {
    const std::span<EventKey> keys(chunk.keys, count(s, chunk));
    const auto rest = std::ranges::stable_partition(keys, [&](EventKey key) { return key < limit; });
    later.insert(later.end(), rest.begin(), rest.end());
    chunk.count = keys.size() - rest.size();
    if (&chunk == &s.chunks.back()) s.next = chunk.keys + chunk.count;
  }
}

}  // namespace pecs::sensor
