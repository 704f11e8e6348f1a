// Prophesee DAT, version 2: a text header, one byte event type, one byte event size (8), then per event two 32-bit
// little-endian words: t_us modulo 2^32; and x in bits 13..0, y in bits 27..14, p in bit 28.
#include <fmt/format.h>

#include "checked_writer.h"
#include "codec.h"
#include "input_file.h"
#include "output_file.h"
#include "raw_header.h"

namespace pecs::events {
namespace {

constexpr int kDatMaxSize = 1 << 14;
constexpr std::int64_t kDatWrap = std::int64_t{1} << 32;
constexpr std::byte kOldType{0x00}, kCdType{0x0c}, kEventBytes{8};

class DatReader final : public EventReader<DatReader> {
 public:
  explicit DatReader(const std::filesystem::path& path) : file_(path) {
    const RawHeader header = parse_raw_header(head_of(path, kHeadBytes));
    info_ = header.info;
    extent_.emplace(info_, kDatMaxSize);
    file_.seek(header.bytes);
    std::byte type_and_size[2];
    file_.read_exactly(type_and_size, "event type and size");
    if ((type_and_size[0] != kOldType && type_and_size[0] != kCdType) || type_and_size[1] != kEventBytes)
      throw file_.damage(fmt::format("event type {} of {} bytes", static_cast<int>(type_and_size[0]),
                                     static_cast<int>(type_and_size[1])),
                         "type 0 or 12 of 8 bytes", 2);
  }

  std::string place() const override { return fmt::format("byte {}", file_.offset() - 8); }

  bool next(Event& event) {
    const auto item = file_.next<std::uint64_t>();
    if (!item) return false;
    // A decrease of t by half its range or more is a wrap.
    const auto t = static_cast<std::int64_t>(*item & 0xffffffff);
    if (t + kDatWrap / 2 <= last_) wraps_ += kDatWrap;
    last_ = t;
    const auto address = static_cast<std::uint32_t>(*item >> 32);
    event = {wraps_ + t, static_cast<std::uint16_t>(address & 0x3fff),
             static_cast<std::uint16_t>(address >> 14 & 0x3fff), static_cast<std::uint8_t>(address >> 28 & 1)};
    if (!extent_->add(event))
      throw file_.damage(fmt::format("an event at pixel ({}, {})", event.x, event.y), extent_->wanted(), 8);
    return true;
  }

 private:
  InputFile file_;
  std::int64_t last_ = 0, wraps_ = 0;
};

// t has 32 bits, and a decrease by half their range means a wrap: a gap must be shorter than 2^31 us = 35 min.
constexpr Limits kDatLimits = {.t_min_us = 0, .max_gap_us = kDatWrap / 2, .max_size = kDatMaxSize};

class DatWriter final : public CheckedWriter {
 public:
  DatWriter(const std::filesystem::path& path, const StreamInfo& size)
      : CheckedWriter(path, size, kDatLimits), file_(path) {
    file_.put_text(fmt::format("% Data file containing CD events.\n% Version 2\n% Height {}\n% Width {}\n", size.height,
                               size.width));
    file_.put(kCdType);
    file_.put(kEventBytes);
  }

 private:
  void put(std::span<const Event> events) override {
    for (const Event& e : events)
      file_.put(static_cast<std::uint64_t>(e.t_us & 0xffffffff) |
                std::uint64_t{e.x | std::uint32_t{e.y} << 14 | std::uint32_t{e.p} << 28} << 32);
  }
  void finish() override { file_.commit(); }

  OutputFile file_;
};

bool is_dat(const RawHeader& header, std::span<const std::byte> head) {
  return header.bytes > 0 && header.encoding.empty() && header.fields.contains("version") &&
         head.size() >= header.bytes + 2 && head[header.bytes + 1] == kEventBytes;
}

}  // namespace

Codec make_dat() {
  return make_codec<DatReader, DatWriter>("dat", "Prophesee DAT version 2", ".dat", kDatLimits,
                                          [](const auto&, auto head) { return is_dat(parse_raw_header(head), head); });
}

}  // namespace pecs::events
