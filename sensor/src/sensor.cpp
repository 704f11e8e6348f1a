#include "pecs/sensor/sensor.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "pecs/error.h"

namespace pecs::sensor {

std::vector<EventKey>& EventOrder::tile(std::size_t index) {
  if (index >= tiles_.size()) tiles_.resize(index + 1);
  return tiles_[index];
}

void EventOrder::take(std::int64_t until_us, std::int64_t origin_us, std::vector<events::Event>& out) {
  tiles_.push_back(std::move(held_));
  held_.clear();
  const EventKey limit = event_key(until_us, 0, false);
  EventKey least = std::numeric_limits<EventKey>::max(), most = 0;
  std::size_t count = 0;
  for (const auto& tile : tiles_)
    for (const EventKey key : tile) {
      least = std::min(least, key);
      if (key >= limit) continue;
      most = std::max(most, key);
      ++count;
    }

  // Counting sort by time, as fine as a moderate table allows, then each bucket by itself.
  const std::int64_t first_us = key_time_us(least), last_us = key_time_us(most);
  int shift = 0;
  while ((last_us - first_us) >> shift >= std::int64_t{1} << 16) ++shift;
  const auto bucket_of = [&](EventKey key) { return static_cast<std::size_t>((key_time_us(key) - first_us) >> shift); };
  std::vector<std::size_t> starts(count ? bucket_of(most) + 2 : 1);
  for (const auto& tile : tiles_)
    for (const EventKey key : tile)
      if (key < limit) ++starts[bucket_of(key) + 1];
  for (std::size_t i = 1; i < starts.size(); ++i) starts[i] += starts[i - 1];
  sorted_.resize(count);
  std::vector<std::size_t> next = starts;
  for (auto& tile : tiles_) {
    for (const EventKey key : tile) {
      if (key < limit)
        sorted_[next[bucket_of(key)]++] = key;
      else
        held_.push_back(key);
    }
    tile.clear();
  }
  tiles_.pop_back();
  for (std::size_t i = 0; i + 1 < starts.size(); ++i) {
    const auto a = sorted_.begin() + static_cast<std::ptrdiff_t>(starts[i]);
    const auto b = sorted_.begin() + static_cast<std::ptrdiff_t>(starts[i + 1]);
    if (!std::is_sorted(a, b)) std::sort(a, b);
  }

  out.reserve(out.size() + count);
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
