#pragma once
// Events on their way from a pixel to the stream.
#include <cstdint>
#include <span>
#include <vector>

namespace pecs::sensor {

// Why an event came: of what moved V from the reference to the threshold, the largest part.
enum class Cause : std::uint8_t { signal, leak, noise, hot };

// An event in one number whose order is the stream's order: time in us (35 bits, 9 hours), then pixel (y * width + x,
// 26 bits), then polarity, then cause (`signal` where nobody asks).
using EventKey = std::uint64_t;
inline constexpr double kMostTime_us = 1.7e10;  // half of that: an event may follow the last frame
inline constexpr int kKeyTimeShift = 29, kKeyPixelShift = 3, kKeyOnShift = 2;
inline EventKey event_key(std::int64_t t_us, std::uint32_t pixel, bool on, Cause cause = Cause::signal) {
  return static_cast<std::uint64_t>(t_us) << kKeyTimeShift | std::uint64_t{pixel} << kKeyPixelShift |
         std::uint64_t{on} << kKeyOnShift | static_cast<std::uint64_t>(cause);
}
inline std::int64_t key_time_us(EventKey key) { return static_cast<std::int64_t>(key >> kKeyTimeShift); }
inline std::uint32_t key_pixel(EventKey key) { return static_cast<std::uint32_t>(key >> kKeyPixelShift) & 0x3ffffff; }
inline bool key_on(EventKey key) { return key >> kKeyOnShift & 1; }
inline Cause key_cause(EventKey key) { return static_cast<Cause>(key & 3); }

// Event keys, by slots of time.
class EventSlots {
 public:
  EventSlots() { begin({}); }
  // edges: rising; slot i begins at edges[i]. The first slot has what comes before it too.
  void begin(std::span<const EventKey> edges) {
    edges_.assign(edges.begin(), edges.end());
    if (edges_.empty()) edges_.push_back(0);
    edges_.front() = 0;
    edges_.push_back(~EventKey{0});
    if (slots_.size() + 1 < edges_.size()) slots_.resize(edges_.size() - 1);
    for (auto& slot : slots_) slot.clear();
    at_ = 0;
  }
  std::size_t size() const { return edges_.size() - 1; }
  std::vector<EventKey>& operator[](std::size_t slot) { return slots_[slot]; }
  // Fast for events that come nearly by time.
  void add(EventKey key) {
    if (key < edges_[at_]) at_ = 0;
    while (key >= edges_[at_ + 1]) ++at_;
    slots_[at_].push_back(key);
  }
  // Fastest when they lie in one slot.
  void add(std::span<const EventKey> keys) {
    if (keys.empty()) return;
    add(keys.front());
    keys = keys.subspan(1);
    const EventKey begin = edges_[at_], length = edges_[at_ + 1] - begin;
    bool here = true;
    for (const EventKey key : keys) here &= key - begin < length;
    if (here)
      slots_[at_].insert(slots_[at_].end(), keys.begin(), keys.end());
    else
      for (const EventKey key : keys) add(key);
  }

 private:
  std::vector<EventKey> edges_;
  std::vector<std::vector<EventKey>> slots_;
  std::size_t at_ = 0;
};

}  // namespace pecs::sensor
