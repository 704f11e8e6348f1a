#include "pecs/sensor/sensor.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "pecs/error.h"

namespace pecs::sensor {

std::vector<EventKey>& EventOrder::tile(std::size_t index) {
  if (index >= tiles_.size()) tiles_.resize(index + 1);
  return tiles_[index];
}

namespace {

// Stable sort by time, digit by digit. Keys' times lie in [first_us, last_us].
void sort_by_time(std::vector<EventKey>& keys, std::vector<EventKey>& scratch, std::int64_t first_us,
                  std::int64_t last_us) {
  const auto bits = static_cast<int>(std::bit_width(static_cast<std::uint64_t>(last_us - first_us)));
  const int passes = (bits + 10) / 11, digit_bits = passes ? (bits + passes - 1) / passes : 0;
  const std::size_t digits = std::size_t{1} << digit_bits;
  scratch.resize(keys.size());
  for (int pass = 0; pass < passes; ++pass) {
    const auto digit = [&](EventKey key) {
      return static_cast<std::size_t>((key_time_us(key) - first_us) >> (pass * digit_bits)) & (digits - 1);
    };
    std::vector<std::size_t> next(digits + 1);
    for (const EventKey key : keys) ++next[digit(key) + 1];
    for (std::size_t i = 1; i < digits; ++i) next[i] += next[i - 1];
    for (const EventKey key : keys) scratch[next[digit(key)]++] = key;
    keys.swap(scratch);
  }
}

}  // namespace

void EventOrder::take(std::int64_t until_us, std::int64_t origin_us, std::vector<events::Event>& out) {
  tiles_.push_back(std::move(held_));
  held_.clear();
  const EventKey limit = event_key(until_us, 0, false);
  EventKey least = std::numeric_limits<EventKey>::max(), most = 0;
  std::size_t count = 0;
  for (const auto& tile : tiles_) count += tile.size();
  sorted_.clear();
  sorted_.reserve(count);
  for (auto& tile : tiles_) {
    for (const EventKey key : tile) {
      if (key >= limit) {
        held_.push_back(key);
        continue;
      }
      least = std::min(least, key);
      most = std::max(most, key);
      sorted_.push_back(key);
    }
    tile.clear();
  }
  tiles_.pop_back();
  if (sorted_.empty()) return;
  sort_by_time(sorted_, scratch_, key_time_us(least), key_time_us(most));
  // Tiles come in the order of their pixels, so that little is left to do among events of one time.
  for (auto a = sorted_.begin(); a != sorted_.end();) {
    auto b = a + 1;
    bool in_order = true;
    for (; b != sorted_.end() && key_time_us(*b) == key_time_us(*a); ++b) in_order &= *(b - 1) <= *b;
    if (!in_order) std::sort(a, b);
    a = b;
  }

  if (out.capacity() < out.size() + sorted_.size())
    out.reserve(std::max(out.size() + sorted_.size(), out.capacity() + out.capacity() / 2));
  for (const EventKey key : sorted_) {
    const std::uint32_t pixel = key_pixel(key);
    out.push_back({key_time_us(key) - origin_us, static_cast<std::uint16_t>(pixel % width_),
                   static_cast<std::uint16_t>(pixel / width_), static_cast<std::uint8_t>(key_on(key))});
  }
}

Sensor::Sensor(const Chip& chip, int width, int height, std::uint64_t seed, double gain_fa, const ModelChoice& model)
    : width_(width), height_(height), model_(open_model(model, chip, width, height, seed, gain_fa)), order_(width) {}

void Sensor::push(std::span<const float* const> planes, std::span<const double> t_us, bool last,
                  std::vector<events::Event>& out) {
  FrameBatch batch{frames_, {planes.begin(), planes.end()}, recent_t_us_, last};
  for (const double t : t_us) {
    if (!(batch.t_us.empty() || t > batch.t_us.back()) || !(t >= 0) || t > 1e11)
      throw bad_input("frames", fmt::format("time of frame {}", frames_), fmt::format("{} us", t),
                      batch.t_us.empty() ? "0 to 1e11" : fmt::format("more than {}", batch.t_us.back()));
    batch.t_us.push_back(t);
    ++frames_;
  }

  model_->advance(batch, order_);

  // Events of the intervals to come round to the end of these at the earliest.
  const std::size_t known = batch.t_us.size();
  recent_t_us_.assign(batch.t_us.end() - static_cast<std::ptrdiff_t>(std::min<std::size_t>(2, known)),
                      batch.t_us.end());
  const std::int64_t until_us = last         ? std::numeric_limits<std::int64_t>::max() >> 28
                                : known >= 2 ? std::llround(recent_t_us_.front())
                                             : 0;
  order_.take(until_us, 0, out);
}

}  // namespace pecs::sensor
