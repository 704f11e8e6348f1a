#include "pecs/sensor/sensor.h"

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <numeric>
#include <utility>

#include "pecs/error.h"

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
  Unpack(int width, std::int64_t origin_us)
      : width_(static_cast<std::uint32_t>(width)), per_width_((kOne + width_ - 1) / width_), origin_us_(origin_us) {}
  void operator()(EventKey key, events::Event& to) const {
    const std::uint32_t pixel = key_pixel(key);
    const auto y = static_cast<std::uint32_t>(pixel * per_width_ >> kShift);
    static_assert(std::endian::native == std::endian::little && offsetof(events::Event, x) == 8 &&
                  offsetof(events::Event, y) == 10 && offsetof(events::Event, p) == 12);
    const std::uint64_t place = std::uint64_t{key_on(key)} << 32 | y << 16 | (pixel - y * width_);
    const std::array words{static_cast<std::uint64_t>(key_time_us(key) - origin_us_), place};
    std::memcpy(static_cast<void*>(&to), words.data(),
                sizeof words);  // member by member it takes several times as long
  }

 private:
  // pixel / width = pixel * per_width >> 40 is exact for pixel * width < 2^40.
  static constexpr int kShift = 40;
  static constexpr std::uint64_t kOne = std::uint64_t{1} << kShift;
  std::uint32_t width_;
  std::uint64_t per_width_;
  std::int64_t origin_us_;
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

void EventSorter::take(std::int64_t until_us, std::int64_t origin_us, LabelledEvents& labelled) {
  const EventKey limit = event_key(until_us, 0, false);
  const std::size_t slots = parts_.empty() ? 0 : parts_.front().size();
  std::vector<std::size_t> ends(slots + 1, 0);
  for (EventSlots& part : parts_)
    for (std::size_t slot = 0; slot < slots; ++slot) {
      std::vector<EventKey>& keys = part[slot];
      if (slot + 1 >= edges_.size() || edges_[slot + 1] > limit) {
        const auto later = std::ranges::stable_partition(keys, [&](EventKey key) { return key < limit; });
        held_.insert(held_.end(), later.begin(), later.end());
        keys.erase(later.begin(), later.end());
      }
      ends[slot + 1] += keys.size();
    }
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
    for (std::size_t slot = range.begin(); slot < range.end(); ++slot) {
      keys.clear();
      for (EventSlots& part : parts_) keys.emplace_back(part[slot]);
      sorted.resize(ends[slot + 1] - ends[slot]);
      if (sorted.empty()) continue;
      const std::int64_t begin_us = key_time_us(edges_[slot]);
      const std::int64_t end_us = slot + 1 < slots ? key_time_us(edges_[slot + 1]) : begin_us + 1000;
      sort_keys(keys, begin_us, end_us, sorted, place);
      events::Event* to = out.data() + before + ends[slot];
      const Unpack unpack(width_, origin_us);
      for (const EventKey key : sorted) unpack(key, *to++);
      if (with_causes_)
        std::ranges::transform(sorted, labelled.causes.begin() + static_cast<std::ptrdiff_t>(before + ends[slot]),
                               key_cause);
    }
  });
  for (EventSlots& part : parts_) part.begin(edges_);
}

Sensor::Sensor(const Chip& chip, int width, int height, std::uint64_t seed, double gain_fa, const ModelChoice& model,
               const SensorExtras& extras)
    : width_(width),
      height_(height),
      model_(open_model(model, chip, width, height, seed, gain_fa, extras.causes)),
      order_(width, extras.causes) {
  if (extras.readout && !is_ideal_readout(chip)) readout_.emplace(chip, width, height, seed);
}

void Sensor::push(std::span<const float* const> planes, std::span<const double> t_us, bool last, LabelledEvents& out) {
  FrameBatch batch{frames_, {planes.begin(), planes.end()}, recent_t_us_, last};
  for (const double t : t_us) {
    if (!(batch.t_us.empty() || t > batch.t_us.back()) || !(t >= 0) || t > kMostTime_us)
      throw bad_input(
          "frames", fmt::format("time of frame {}", frames_ + std::ssize(batch.t_us) - std::ssize(recent_t_us_)),
          fmt::format("{} us", t),
          batch.t_us.empty() ? fmt::format("0 to {}", kMostTime_us) : fmt::format("more than {}", batch.t_us.back()));
    batch.t_us.push_back(t);
  }
  frames_ += std::ssize(planes);

  order_.begin(batch.t_us);
  model_->advance(batch, order_);

  // Events of the intervals to come round to the end of these at the earliest.
  const std::size_t known = batch.t_us.size();
  recent_t_us_.assign(batch.t_us.end() - static_cast<std::ptrdiff_t>(std::min<std::size_t>(2, known)),
                      batch.t_us.end());
  const std::int64_t until_us = last         ? std::int64_t{1} << (63 - kKeyTimeShift)
                                : known >= 2 ? std::llround(recent_t_us_.front())
                                             : 0;
  if (!readout_) return order_.take(until_us, 0, out);
  fired_.events.clear();
  fired_.causes.clear();
  order_.take(until_us, 0, fired_);
  readout_->push(fired_, last, out);
}

}  // namespace pecs::sensor
