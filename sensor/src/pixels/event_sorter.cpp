#include "pecs/sensor/event_sorter.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>

#include "pecs/platform.h"
#include "pixels/unpack_kernel.h"

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
    platform::ask_for_huge_pages(slabs_.back().get(), slab_ * sizeof(EventKey));
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

void EventSorter::begin(std::span<const double> t_us) {
  edges_.clear();
  for (const double t : t_us) {
    const EventKey edge = event_key(std::llround(t), 0, false);
    if (edges_.empty() || edge > edges_.back()) edges_.push_back(edge);
  }
  for (EventSlots& part : parts_) part.begin(edges_);
  for (const EventKey key : held_) part(0).add(key);
  held_.clear();
}

EventSlots& EventSorter::part(std::size_t index) {
  while (parts_.size() <= index) parts_.emplace_back().begin(edges_);
  return parts_[index];
}

namespace {

// Splits a slot's time into about as many runs as it has keys. A copy of it in a loop stays in registers. kInside: all
// keys lie within the slot's time.
template <bool kInside>
struct Runs {
  Runs(std::size_t keys, std::int64_t begin_us, std::int64_t end_us) : begin(event_key(begin_us, 0, false)) {
    const std::int64_t most = std::clamp<std::int64_t>(static_cast<std::int64_t>(keys), 1, 1 << 16);
    int us_shift = 0;
    while ((end_us - begin_us) >> us_shift >= most) ++us_shift;
    shift = us_shift + kKeyTimeShift;
    last = static_cast<std::uint64_t>((end_us - begin_us) >> us_shift);
  }
  std::size_t of(EventKey key) const {
    return kInside ? (key - begin) >> shift : std::min((std::max(key, begin) - begin) >> shift, last);
  }

  EventKey begin;
  std::uint64_t last;
  int shift;
};

// Sorts the keys of a slot into runs, and each run by insertion. Each thread reuses one sorter for all its slots.
class KeySorter {
 public:
  // The keys lie in several parts.
  template <bool kInside>
  std::span<const EventKey> sort(std::span<const std::span<const EventKey>> parts, std::size_t count,
                                 const Runs<kInside> runs) {
    run_.assign(runs.last + 2, 0);
    std::uint32_t* const run = run_.data();
    for (std::size_t part = 0; part < parts.size(); ++part) {
      const std::span<const EventKey> keys = parts[part];
      const EventKey* const next = part + 1 < parts.size() ? parts[part + 1].data() : keys.data();
      for (std::size_t i = 0; i < keys.size(); ++i) {
        if (i % 8 == 0) __builtin_prefetch(next + i);  // chunks are scattered in memory
        ++run[runs.of(keys[i]) + 1];
      }
    }
    std::partial_sum(run_.begin(), run_.end(), run_.begin());

    // Keys are nearly sorted by pixel, so few move back within their run. The value before a run, the end of another
    // one, is a smaller key or still 0, and ends an insertion.
    sorted_.resize(std::max(sorted_.size(), count + 1));
    EventKey* const sorted = sorted_.data() + 1;
    for (const std::uint32_t begin : run_) sorted[std::ptrdiff_t{begin} - 1] = 0;
    const std::size_t most_moves = 16 * count;
    std::size_t moves = 0;
    for (const auto keys : parts)
      for (const EventKey key : keys) {
        EventKey* to = sorted + run[runs.of(key)]++;
        for (; to[-1] > key && moves <= most_moves; --to, ++moves) *to = to[-1];
        *to = key;
      }
    if (moves > most_moves) std::sort(sorted, sorted + count);  // not nearly in order
    return {sorted, count};
  }

 private:
  std::vector<EventKey> sorted_;
  std::vector<std::uint32_t> run_;  // where a run begins, then where its next key goes
};

}  // namespace

// Appends the keys of slots [first_slot, end_slot) of all parts.
void EventSorter::append_sorted(std::size_t first_slot, std::size_t end_slot, LabelledEvents& labelled) {
  const std::size_t slots = end_slot - first_slot;
  std::vector<std::size_t> ends(slots + 1, 0);
  for (EventSlots& part : parts_)
    for (std::size_t i = 0; i < slots; ++i) ends[i + 1] += part.count(first_slot + i);
  std::partial_sum(ends.begin(), ends.end(), ends.begin());

  auto& out = labelled.events;
  const std::size_t before = out.size();
  if (out.capacity() < before + ends[slots]) {
    out.reserve(std::max(before + ends[slots], 2 * out.capacity()));
    platform::ask_for_huge_pages(out.data(), out.capacity() * sizeof(events::Event));
  }
  out.resize(before + ends[slots]);
  if (with_causes_) labelled.causes.resize(out.size());
  tbb::enumerable_thread_specific<KeySorter> sorters;
  tbb::parallel_for(std::size_t{0}, slots, [&](std::size_t i) {
    const std::size_t slot = first_slot + i, count = ends[i + 1] - ends[i];
    if (count == 0) return;
    const std::int64_t begin_us = key_time_us(edges_[slot]);
    const std::int64_t end_us = slot + 1 < edges_.size() ? key_time_us(edges_[slot + 1]) : begin_us + 1000;
    std::vector<std::span<const EventKey>> keys;
    for (const EventSlots& part : parts_) part.find(slot, keys);
    KeySorter& sorter = sorters.local();
    const bool inside = slot > 0 && slot + 1 < edges_.size();
    const auto sorted = inside ? sorter.sort(keys, count, Runs<true>(count, begin_us, end_us))
                               : sorter.sort(keys, count, Runs<false>(count, begin_us, end_us));
    unpack_events(sorted, width_, out.data() + before + ends[i]);
    if (with_causes_)
      std::ranges::transform(sorted, labelled.causes.begin() + static_cast<std::ptrdiff_t>(before + ends[i]),
                             key_cause);
  });
}

void EventSorter::take(std::int64_t until_us, LabelledEvents& out) {
  const EventKey limit = event_key(until_us, 0, false);
  const std::size_t slots = parts_.empty() ? 0 : parts_.front().size();
  for (EventSlots& part : parts_)
    for (std::size_t slot = 0; slot < slots; ++slot) {
      if (slot + 1 < edges_.size() && edges_[slot + 1] <= limit) continue;
      part.take_later(slot, limit, held_);
    }
  if (until_us > from_us_) append_sorted(0, slots, out);
  for (EventSlots& part : parts_) part.begin(edges_);
}

void EventSorter::begin_window(std::int64_t from_us, std::int64_t to_us) {
  constexpr int kSlots = 256;
  std::vector<double> t_us;
  if (from_us > 0) t_us.push_back(0);
  for (int i = 0; i <= kSlots; ++i)
    t_us.push_back(static_cast<double>(from_us) + std::floor(static_cast<double>(to_us - from_us) * i / kSlots));
  begin(t_us);
  window_first_ = from_us > 0 ? 1 : 0;
}

void EventSorter::drop_outside() {
  for (EventSlots& part : parts_) {
    if (window_first_ > 0) part.clear(0);
    part.clear(edges_.size() - 1);
  }
}

void EventSorter::take_window(const std::function<void(LabelledEvents&, bool)>& sink) {
  constexpr std::size_t kTogether = 16;
  const std::size_t end = edges_.size() - 1;
  for (std::size_t slot = window_first_; slot < end; slot += kTogether) {
    const std::size_t next = std::min(end, slot + kTogether);
    LabelledEvents out;
    append_sorted(slot, next, out);
    for (EventSlots& part : parts_)
      for (std::size_t i = slot; i < next; ++i) part.clear(i);
    sink(out, next == end);
  }
}

}  // namespace pecs::sensor
