// Prophesee EVT2.1: 64-bit words, type in bits 63..60.
//   0, 1   events of p = type at (x + k, y) for every set bit k of 31..0: bits 5..0 of t_us in 59..54, x in 53..43,
//          y in 42..32
//   8      TIME_HIGH: bits 33..6 of t_us in 59..32; t wraps every 2^34 us
//   10     trigger; 14, 15 others: skipped
// Little-endian; with "endianness=legacy" in the header the two 32-bit halves of a word come in the other order.
#include <bit>

#include "checked_writer.h"
#include "output_file.h"
#include "raw_reader.h"

namespace pecs::events {
namespace {

constexpr int kEvt21MaxSize = 2048;
constexpr std::uint64_t kEvt21TimeHigh = 8;
constexpr std::int64_t kEvt21Highs = std::int64_t{1} << 28;

class Evt21Reader final : public RawReader<Evt21Reader, std::uint64_t> {
 public:
  explicit Evt21Reader(const std::filesystem::path& path)
      : RawReader(path, kEvt21MaxSize), halves_swapped_(options_["endianness"] == "legacy") {}

  bool next(Event& event) {
    while (mask_ == 0) {
      auto word = next_word();
      if (!word) return false;
      if (halves_swapped_) word = std::rotl(*word, 32);
      const std::uint64_t type = *word >> 60;
      if (type == kEvt21TimeHigh) {
        high_.take(static_cast<std::int64_t>(*word >> 32 & 0x0fffffff));
      } else if (type <= 1 && high_.known()) {
        event_ = {(high_.value() << 6) | static_cast<std::int64_t>(*word >> 54 & 0x3f), 0,
                  static_cast<std::uint16_t>(*word >> 32 & 0x7ff), static_cast<std::uint8_t>(type)};
        base_x_ = static_cast<unsigned>(*word >> 43 & 0x7ff);
        mask_ = static_cast<std::uint32_t>(*word);
      }
    }
    event_.x = static_cast<std::uint16_t>(base_x_ + std::countr_zero(mask_));
    mask_ &= mask_ - 1;
    check_inside(event = event_);
    return true;
  }

 private:
  const bool halves_swapped_;
  TimeHighReader high_{kEvt21Highs};
  Event event_;
  unsigned base_x_ = 0;
  std::uint32_t mask_ = 0;
};

constexpr Limits kEvt21Limits = {.t_min_us = 0, .t_max_us = std::int64_t{1} << 50, .max_size = kEvt21MaxSize};

class Evt21Writer final : public RunWriter {
 public:
  Evt21Writer(const std::filesystem::path& path, const StreamInfo& size)
      : RunWriter(path, size, kEvt21Limits), file_(path) {
    file_.put_text(raw_header_text("EVT21", "2.1", size, ";endianness=little"));
    put_high(0);
  }

 private:
  // A run to the right at one time and polarity within 32 aligned pixels is one word.
  std::size_t run(std::span<const Event> events) const override {
    const Event& first = events[0];
    std::size_t n = 1;
    while (n < events.size() && events[n].t_us == first.t_us && events[n].y == first.y && events[n].p == first.p &&
           events[n].x / 32 == first.x / 32 && events[n].x > events[n - 1].x)
      ++n;
    return n;
  }

  std::size_t put_run(std::span<const Event> events) override {
    const Event& first = events[0];
    const std::int64_t high = first.t_us >> 6;
    step_time_high(high_, high, kEvt21Highs, [&](std::int64_t next) { put_high(next); });
    high_ = high;
    std::uint64_t mask = 0;
    for (const Event& e : events) mask |= std::uint64_t{1} << (e.x % 32);
    file_.put(std::uint64_t{first.p} << 60 | static_cast<std::uint64_t>(first.t_us & 0x3f) << 54 |
              static_cast<std::uint64_t>(first.x & ~31) << 43 | std::uint64_t{first.y} << 32 | mask);
    return events.size();
  }
  void finish_file() override { file_.commit(); }

  void put_high(std::int64_t high) {
    file_.put(kEvt21TimeHigh << 60 | static_cast<std::uint64_t>(high % kEvt21Highs) << 32);
  }

  OutputFile file_;
  std::int64_t high_ = 0;
};

}  // namespace

Codec make_evt21() {
  return make_raw_codec<Evt21Reader, Evt21Writer>("evt21", "Prophesee RAW EVT2.1", "EVT21", kEvt21Limits);
}

}  // namespace pecs::events
