// Prophesee EVT3: 16-bit little-endian words, type in bits 15..12.
//   0 ADDR_Y     y in 10..0
//   2 ADDR_X     x in 10..0, p in bit 11: one event at (x, y, t)
//   3 VECT_BASE  x in 10..0, p in bit 11: where the next vector begins
//   4 VECT_12    events at base + k for every set bit k of 11..0; then base += 12
//   5 VECT_8     the same with bits 7..0; then base += 8
//   6 TIME_LOW   bits 11..0 of t_us
//   8 TIME_HIGH  bits 23..12 of t_us; t wraps every 2^24 us = 16.777 s, and readers count the wraps
//   7, 10..15    continuations, triggers, IMU, counters: skipped
#include <bit>

#include "checked_writer.h"
#include "output_file.h"
#include "raw_reader.h"

namespace pecs::events {
namespace {

enum Type : unsigned { addr_y = 0, addr_x = 2, vect_base = 3, vect_12 = 4, vect_8 = 5, time_low = 6, time_high = 8 };

constexpr int kEvt3MaxSize = 2048;
constexpr std::int64_t kEvt3Highs = 4096;  // TIME_HIGH values in a wrap

class Evt3Reader final : public RawReader<Evt3Reader, std::uint16_t> {
 public:
  explicit Evt3Reader(const std::filesystem::path& path) : RawReader(path, kEvt3MaxSize) {}

  bool next(Event& event) {
    while (mask_ == 0) {
      const auto word = next_word();
      if (!word) return false;
      const unsigned value = *word & 0xfff;
      switch (*word >> 12) {
        case addr_y:
          event_.y = value & 0x7ff;
          break;
        case addr_x:
          if (!high_.known()) break;
          event_.x = value & 0x7ff;
          event_.p = static_cast<std::uint8_t>(value >> 11);
          check_inside(event = event_);
          return true;
        case vect_base:
          base_x_ = value & 0x7ff;
          base_p_ = static_cast<std::uint8_t>(value >> 11);
          break;
        case vect_12:
          take_vector(value, 12);
          break;
        case vect_8:
          take_vector(value & 0xff, 8);
          break;
        case time_low:
          low_ = value;
          event_.t_us = (high_.value() << 12) | low_;
          break;
        case time_high:
          take_time_high(value);
          break;
        default:
          break;
      }
    }
    event_.x = static_cast<std::uint16_t>(mask_x_ + std::countr_zero(mask_));
    mask_ &= mask_ - 1;
    check_inside(event = event_);
    return true;
  }

 private:
  void take_vector(unsigned bits, int size) {
    mask_ = high_.known() ? bits : 0;
    mask_x_ = base_x_;
    event_.p = base_p_;
    base_x_ += size;
    if (base_x_ > kEvt3MaxSize + 32)
      throw damage(fmt::format("a vector up to x = {}", base_x_), fmt::format("x below {}", kEvt3MaxSize));
  }

  // Until the next TIME_LOW, a new high part counts from its start.
  void take_time_high(unsigned value) {
    const std::int64_t before = high_.value();
    high_.take(value);
    if (high_.value() != before) low_ = 0;
    event_.t_us = (high_.value() << 12) | low_;
  }

  Event event_;
  TimeHighReader high_{kEvt3Highs};
  std::int64_t low_ = 0;
  int base_x_ = 0, mask_x_ = 0;
  std::uint8_t base_p_ = 0;
  unsigned mask_ = 0;
};

constexpr Limits kEvt3Limits = {.t_min_us = 0, .t_max_us = 10'000'000'000'000, .max_size = kEvt3MaxSize};

class Evt3Writer final : public RunWriter {
 public:
  Evt3Writer(const std::filesystem::path& path, const StreamInfo& size)
      : RunWriter(path, size, kEvt3Limits), file_(path) {
    file_.put_text(raw_header_text("EVT3", "3.0", size));
    put_time(0, 0);
  }

 private:
  // A run to the right at one time and polarity in one vector of 32 pixels that ends inside the sensor.
  std::size_t run(std::span<const Event> events) const override {
    const Event& first = events[0];
    if (info().width < 32) return 1;
    const int end = std::max<int>(std::min(first.x + 32, info().width), 32);
    std::size_t n = 1;
    while (n < events.size() && events[n].t_us == first.t_us && events[n].y == first.y && events[n].p == first.p &&
           events[n].x > events[n - 1].x && events[n].x < end)
      ++n;
    return n;
  }

  // As a vector where that is shorter.
  std::size_t put_run(std::span<const Event> events) override {
    const Event& e = events[0];
    step_to(e.t_us);
    if (e.y != y_) word(addr_y, static_cast<unsigned>(y_ = e.y));
    if (events.size() > 4) {
      put_vector(events);
      return events.size();
    }
    word(addr_x, unsigned{e.x} | unsigned{e.p} << 11);
    return 1;
  }

  void finish_file() override { file_.commit(); }

  void word(unsigned type, unsigned value) { file_.put(static_cast<std::uint16_t>(type << 12 | value)); }

  void put_time(std::int64_t high, std::int64_t low) {
    high_ = high;
    low_ = low;
    word(time_high, static_cast<unsigned>(high % kEvt3Highs));
    word(time_low, static_cast<unsigned>(low));
  }

  void step_to(std::int64_t t_us) {
    const std::int64_t high = t_us >> 12, low = t_us & 0xfff;
    step_time_high(high_, high, kEvt3Highs, [&](std::int64_t next) { put_time(next, next == high ? low : 0); });
    if (low != low_) word(time_low, static_cast<unsigned>(low_ = low));
  }

  void put_vector(std::span<const Event> events) {
    const unsigned base = std::min<unsigned>(events[0].x, static_cast<unsigned>(info().width - 32));
    std::uint32_t mask = 0;
    for (const Event& e : events) mask |= 1u << (e.x - base);
    word(vect_base, base | unsigned{events[0].p} << 11);
    word(vect_12, mask & 0xfff);
    word(vect_12, mask >> 12 & 0xfff);
    word(vect_8, mask >> 24);
  }

  OutputFile file_;
  std::int64_t high_ = 0, low_ = 0;
  int y_ = -1;
};

}  // namespace

Codec make_evt3() { return make_raw_codec<Evt3Reader, Evt3Writer>("evt3", "Prophesee RAW EVT3", "EVT3", kEvt3Limits); }

}  // namespace pecs::events
