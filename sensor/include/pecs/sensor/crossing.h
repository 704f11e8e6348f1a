#pragma once
// Threshold crossings of one pixel within one frame interval.
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

// c0 + c1 s + c2 s^2 + c3 s^3 on [0, 1].
struct Cubic {
  double c0, c1, c2, c3;
  double at(double s) const { return c0 + s * (c1 + s * (c2 + s * c3)); }
};
Cubic hermite(double v0, double v1, double m0, double m1);

struct Crossing {
  double s;  // > 1: none
  bool on;
};
// The first s >= from where the cubic is >= high (on) or <= low (off).
Crossing first_crossing(const Cubic& q, double from, double low, double high);

// An event that noise makes, whatever the light does.
struct BackgroundEvent {
  double t_us;
  std::uint32_t pixel;
  bool on;
  Cause cause = Cause::noise;
};

// What a pixel's last reset found, to tell causes.
struct ResetMark {
  double t_us = 0;
  float noise = 0;
};

// One pixel over one interval. V is the photoreceptor's output (ln), n its noise (linear in between).
struct PixelInterval {
  double t0_us, h_us;
  std::uint32_t pixel;
  double l0, l1, m0, m1;  // ln of photo- plus dark current [fA]; slopes per interval
  double w0, w1;          // photoreceptor state 1/u [1/fA]; w1 is written when a > 0
  double n0, n1;          // noise at the ends
  double threshold_on, threshold_off;
  double reference;                             // in and out: V at the last reset
  double blind_us;                              // in and out: time left until the reference is taken
  std::span<const BackgroundEvent> background;  // within the interval, in time order
  ResetMark* mark = nullptr;                    // in and out; null: causes are not told
};

struct PixelConstants {
  double a_per_us = 0;  // 2 pi * corner per fA and us; 0: V = ln I
  double leak_per_us = 0;
  double refractory_us = 0;
};

// Adds the interval's events; with their causes when there is a mark.
void find_events(const PixelConstants& constants, PixelInterval& pixel, EventSlots& events);

}  // namespace pecs::sensor
