#pragma once
// Events on their way from a pixel to the stream.
#include <cstdint>

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

}  // namespace pecs::sensor
