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
#include <iterator>
#include <limits>
#include <utility>

#include "pecs/error.h"

namespace pecs::sensor {

std::vector<EventKey>& EventOrder::tile(std::size_t index) {
  if (index >= tiles_.size()) tiles_.resize(index + 1);
  return tiles_[index];
}

namespace {

// Sorts keys whose times lie less than 2^bits us after first_us: stably by time, digit by digit, then those of one
// time, which tiles bring in order but for few. The result lies in one of both.
std::span<const EventKey> sort_keys(std::span<EventKey> keys, std::vector<EventKey>& scratch, std::int64_t first_us,
                                    int bits) {
  constexpr int kDigitBits = 11;
  if (scratch.size() < keys.size()) scratch.resize(keys.size());
  std::array<std::uint32_t, (1 << kDigitBits) + 1> next;
  std::span<EventKey> from = keys, to = std::span(scratch).first(keys.size());
  for (int shift = 0; shift < bits; shift += kDigitBits) {
    const std::size_t digits = std::size_t{1} << std::min(kDigitBits, bits - shift);
    const auto digit = [&](EventKey key) {
      return static_cast<std::size_t>(key_time_us(key) - first_us) >> shift & (digits - 1);
    };
    std::fill_n(next.begin(), digits + 1, 0u);
    for (const EventKey key : from) ++next[digit(key) + 1];
    for (std::size_t i = 1; i < digits; ++i) next[i] += next[i - 1];
    for (const EventKey key : from) to[next[digit(key)]++] = key;
    std::swap(from, to);
  }
  for (auto a = from.begin(); a != from.end();) {
    auto b = a + 1;
    bool in_order = true;
    for (; b != from.end() && key_time_us(*b) == key_time_us(*a); ++b) in_order &= *(b - 1) <= *b;
    if (!in_order) std::sort(a, b);
    a = b;
  }
  return from;
}

}  // namespace

void EventOrder::write(EventKey key, std::int64_t origin_us, events::Event& to) const {
  const std::uint32_t pixel = key_pixel(key);
  const auto y = static_cast<std::uint32_t>((pixel + 0.5) * per_width_);  // half a pixel from where it would round
  static_assert(std::endian::native == std::endian::little && offsetof(events::Event, x) == 8 &&
                offsetof(events::Event, y) == 10 && offsetof(events::Event, p) == 12);
  const std::uint64_t place = std::uint64_t{key_on(key)} << 32 | y << 16 | (pixel - y * width_);
  const std::array words{static_cast<std::uint64_t>(key_time_us(key) - origin_us), place};
  std::memcpy(static_cast<void*>(&to), words.data(), sizeof words);  // member by member it takes several times as long
}

void EventOrder::take(std::int64_t until_us, std::int64_t origin_us, LabelledEvents& labelled) {
  std::vector<events::Event>& out = labelled.events;
  constexpr std::size_t kSlots = 256;  // of time, that are sorted by themselves
  tiles_.push_back(std::move(held_));
  held_.clear();
  const EventKey limit = event_key(until_us, 0, false);
  struct Tile {
    EventKey least = std::numeric_limits<EventKey>::max(), most = 0;
    std::size_t count = 0;  // before `until_us`
    std::array<std::size_t, kSlots> next{};
  };
  std::vector<Tile> tiles(tiles_.size());
  const auto over_tiles = [&](auto&& work) {
    tbb::parallel_for(std::size_t{0}, tiles.size(), [&](std::size_t i) { work(tiles[i], tiles_[i]); });
  };
  over_tiles([&](Tile& tile, const std::vector<EventKey>& keys) {
    for (const EventKey key : keys)
      if (key < limit) {
        tile.least = std::min(tile.least, key);
        tile.most = std::max(tile.most, key);
        ++tile.count;
      }
  });
  EventKey least = std::numeric_limits<EventKey>::max(), most = 0;
  for (const Tile& tile : tiles) {
    least = std::min(least, tile.least);
    most = std::max(most, tile.most);
  }
  const std::int64_t first_us = key_time_us(least);
  int shift = 0;
  while (least <= most && (key_time_us(most) - first_us) >> shift >= static_cast<std::int64_t>(kSlots)) ++shift;
  const auto slot_of = [&](EventKey key) { return static_cast<std::size_t>((key_time_us(key) - first_us) >> shift); };

  over_tiles([&](Tile& tile, const std::vector<EventKey>& keys) {
    for (const EventKey key : keys)
      if (key < limit) ++tile.next[slot_of(key)];
  });
  std::array<std::size_t, kSlots + 1> slots{};
  std::size_t count = 0;
  for (std::size_t slot = 0; slot < kSlots; ++slot) {
    slots[slot] = count;
    for (Tile& tile : tiles) count += std::exchange(tile.next[slot], count);
  }
  slots[kSlots] = count;
  sorted_.resize(count);
  over_tiles([&](Tile& tile, const std::vector<EventKey>& keys) {
    for (const EventKey key : keys)
      if (key < limit) sorted_[tile.next[slot_of(key)]++] = key;
  });
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    if (tiles[i].count < tiles_[i].size())
      std::ranges::copy_if(tiles_[i], std::back_inserter(held_), [&](EventKey key) { return key >= limit; });
    tiles_[i].clear();
  }
  tiles_.pop_back();

  const std::size_t before = out.size();
  if (out.capacity() < before + count) out.reserve(std::max(before + count, 2 * out.capacity()));
  out.resize(before + count);
  if (with_causes_) labelled.causes.resize(before + count);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, kSlots, 4), [&](const auto& range) {
    std::vector<EventKey> scratch;
    for (std::size_t slot = range.begin(); slot < range.end(); ++slot) {
      const auto keys = std::span(sorted_).subspan(slots[slot], slots[slot + 1] - slots[slot]);
      events::Event* to = out.data() + before + slots[slot];
      const std::int64_t slot_us = first_us + (static_cast<std::int64_t>(slot) << shift);
      const auto in_order = sort_keys(keys, scratch, slot_us, shift);
      for (const EventKey key : in_order) write(key, origin_us, *to++);
      if (with_causes_)
        std::ranges::transform(in_order, labelled.causes.begin() + static_cast<std::ptrdiff_t>(before + slots[slot]),
                               key_cause);
    }
  });
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
          "frames", fmt::format("time of frame {}", frames_), fmt::format("{} us", t),
          batch.t_us.empty() ? fmt::format("0 to {}", kMostTime_us) : fmt::format("more than {}", batch.t_us.back()));
    batch.t_us.push_back(t);
    ++frames_;
  }

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
