// Prophesee EVT2: 32-bit little-endian words, type in bits 31..28.
//   0, 1   an event of p = type: bits 5..0 of t_us in 27..22, x in 21..11, y in 10..0
//   8      TIME_HIGH: bits 33..6 of t_us in 27..0; t wraps every 2^34 us = 4 h 46 min
//   10     trigger; 14, 15 others: skipped
#include "checked_writer.h"
#include "output_file.h"
#include "raw_reader.h"

namespace pecs::events {
namespace {

constexpr int kEvt2MaxSize = 2048;
constexpr unsigned kEvt2TimeHigh = 8;
constexpr std::int64_t kEvt2Highs = std::int64_t{1} << 28;

class Evt2Reader final : public RawReader<Evt2Reader, std::uint32_t> {
 public:
  explicit Evt2Reader(const std::filesystem::path& path) : RawReader(path, kEvt2MaxSize) {}

  bool next(Event& event) {
    while (const auto word = next_word()) {
      const unsigned type = *word >> 28;
      if (type == kEvt2TimeHigh) {
        high_.take(*word & 0x0fffffff);
      } else if (type <= 1 && high_.known()) {
        check_inside(event = {(high_.value() << 6) | (*word >> 22 & 0x3f),
                              static_cast<std::uint16_t>(*word >> 11 & 0x7ff),
                              static_cast<std::uint16_t>(*word & 0x7ff), static_cast<std::uint8_t>(type)});
        return true;
      }
    }
    return false;
  }

 private:
  TimeHighReader high_{kEvt2Highs};
};

constexpr Limits kEvt2Limits = {.t_min_us = 0, .t_max_us = std::int64_t{1} << 50, .max_size = kEvt2MaxSize};

class Evt2Writer final : public CheckedWriter {
 public:
  Evt2Writer(const std::filesystem::path& path, const StreamInfo& size)
      : CheckedWriter(path, size, kEvt2Limits), file_(path) {
    file_.put_text(raw_header_text("EVT2", "2.0", size));
    put_high(0);
  }

 private:
  void put(std::span<const Event> events) override {
    for (const Event& e : events) {
      const std::int64_t high = e.t_us >> 6;
      step_time_high(high_, high, kEvt2Highs, [&](std::int64_t next) { put_high(next); });
      high_ = high;
      file_.put(std::uint32_t{e.p} << 28 | static_cast<std::uint32_t>(e.t_us & 0x3f) << 22 | std::uint32_t{e.x} << 11 |
                e.y);
    }
  }
  void finish() override { file_.commit(); }

  void put_high(std::int64_t high) { file_.put(kEvt2TimeHigh << 28 | static_cast<std::uint32_t>(high % kEvt2Highs)); }

  OutputFile file_;
  std::int64_t high_ = 0;
};

}  // namespace

Codec make_evt2() { return make_raw_codec<Evt2Reader, Evt2Writer>("evt2", "Prophesee RAW EVT2", "EVT2", kEvt2Limits); }

}  // namespace pecs::events
