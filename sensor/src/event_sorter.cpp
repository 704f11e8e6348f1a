#include "pecs/sensor/event_sorter.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <numeric>

namespace pecs::sensor {

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

// Events of keys. A copy of it in a loop stays in registers.
class Unpack {
 public:
  explicit Unpack(int width) : width_(static_cast<std::uint32_t>(width)), per_width_((kOne + width_ - 1) / width_) {}
  void operator()(EventKey key, events::Event& to) const {
    const std::uint32_t pixel = key_pixel(key);
    const auto y = static_cast<std::uint32_t>(pixel * per_width_ >> kShift);
    static_assert(std::endian::native == std::endian::little && offsetof(events::Event, x) == 8 &&
                  offsetof(events::Event, y) == 10 && offsetof(events::Event, p) == 12);
    const std::uint64_t place = std::uint64_t{key_on(key)} << 32 | y << 16 | (pixel - y * width_);
    const std::array words{static_cast<std::uint64_t>(key_time_us(key)), place};
    std::memcpy(static_cast<void*>(&to), words.data(),
                sizeof words);  // member by member it takes several times as long
  }

 private:
  // pixel / width = pixel * per_width >> 40 is exact for pixel * width < 2^40.
  static constexpr int kShift = 40;
  static constexpr std::uint64_t kOne = std::uint64_t{1} << kShift;
  std::uint32_t width_;
  std::uint64_t per_width_;
};

// Sorts keys of a time: into runs of about as many us as there are keys, and those by insertion. `place`: scratch.
void sort_keys(std::span<const std::span<const EventKey>> parts, std::int64_t begin_us, std::int64_t end_us,
               std::span<EventKey> sorted, std::vector<std::uint32_t>& place) {
  const std::int64_t most_runs = std::clamp<std::int64_t>(2 * std::ssize(sorted), 1, 1 << 14);
  int shift = 0;
  while ((end_us - begin_us) >> shift >= most_runs) ++shift;
  const std::int64_t last = (end_us - begin_us) >> shift;
  const auto run_of = [&](EventKey key) {
    return static_cast<std::size_t>(std::clamp((key_time_us(key) - begin_us) >> shift, std::int64_t{0}, last));
  };
  place.assign(static_cast<std::size_t>(last) + 2, 0);
  for (const auto keys : parts)
    for (const EventKey key : keys) ++place[run_of(key) + 1];
  std::partial_sum(place.begin(), place.end(), place.begin());
  for (const auto keys : parts)
    for (const EventKey key : keys) sorted[place[run_of(key)]++] = key;

  std::size_t moves = 0;
  for (std::size_t i = 1; i < sorted.size(); ++i) {
    const EventKey key = sorted[i];
    std::size_t to = i;
    for (; to > 0 && sorted[to - 1] > key; --to) sorted[to] = sorted[to - 1];
    sorted[to] = key;
    moves += i - to;
    if (moves > 16 * sorted.size()) {  // not nearly in order
      std::ranges::sort(sorted);
      return;
    }
  }
}

}  // namespace

// Slots [first_slot, end_slot) of all parts.
void EventSorter::append_sorted(std::size_t first_slot, std::size_t end_slot, LabelledEvents& labelled) {
  const std::size_t slots = end_slot - first_slot;
  std::vector<std::size_t> ends(slots + 1, 0);
  for (EventSlots& part : parts_)
    for (std::size_t i = 0; i < slots; ++i) ends[i + 1] += part[first_slot + i].size();
  std::partial_sum(ends.begin(), ends.end(), ends.begin());

  std::vector<events::Event>& out = labelled.events;
  const std::size_t before = out.size();
  if (out.capacity() < before + ends[slots]) out.reserve(std::max(before + ends[slots], 2 * out.capacity()));
  out.resize(before + ends[slots]);
  if (with_causes_) labelled.causes.resize(out.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, slots), [&](const auto& range) {
    std::vector<EventKey> sorted;
    std::vector<std::uint32_t> place;
    std::vector<std::span<const EventKey>> keys;
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      const std::size_t slot = first_slot + i;
      keys.clear();
      for (EventSlots& part : parts_) keys.emplace_back(part[slot]);
      sorted.resize(ends[i + 1] - ends[i]);
      if (sorted.empty()) continue;
      const std::int64_t begin_us = key_time_us(edges_[slot]);
      const std::int64_t end_us = slot + 1 < edges_.size() ? key_time_us(edges_[slot + 1]) : begin_us + 1000;
      sort_keys(keys, begin_us, end_us, sorted, place);
      events::Event* to = out.data() + before + ends[i];
      const Unpack unpack(width_);
      for (const EventKey key : sorted) unpack(key, *to++);
      if (with_causes_)
        std::ranges::transform(sorted, labelled.causes.begin() + static_cast<std::ptrdiff_t>(before + ends[i]),
                               key_cause);
    }
  });
}

void EventSorter::take(std::int64_t until_us, LabelledEvents& out) {
  const EventKey limit = event_key(until_us, 0, false);
  const std::size_t slots = parts_.empty() ? 0 : parts_.front().size();
  for (EventSlots& part : parts_)
    for (std::size_t slot = 0; slot < slots; ++slot) {
      if (slot + 1 < edges_.size() && edges_[slot + 1] <= limit) continue;
      std::vector<EventKey>& keys = part[slot];
      const auto later = std::ranges::stable_partition(keys, [&](EventKey key) { return key < limit; });
      held_.insert(held_.end(), later.begin(), later.end());
      keys.erase(later.begin(), later.end());
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
    if (window_first_ > 0) part[0].clear();
    part[edges_.size() - 1].clear();
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
      for (std::size_t i = slot; i < next; ++i) part[i] = {};
    sink(out, next == end);
  }
}

}  // namespace pecs::sensor
