// Prophesee DAT: a text header, one byte event type, one byte event size (8), then per event two 32-bit little-endian
// words: t_us modulo 2^32; and the address: in version 2, x in bits 13..0, y in bits 27..14, p in bit 28; in version 1
// (ATIS, 304x240 unless the header has a size), x in bits 8..0, y in bits 16..9, p in bit 17. A header without a
// version: the first one with a bit above 17 is version 2.
#include <fmt/format.h>

#include "checked_writer.h"
#include "codec.h"
#include "input_file.h"
#include "output_file.h"
#include "pecs/error.h"
#include "raw_header.h"

namespace pecs::events {
namespace {

constexpr int kDatMaxSize = 1 << 14;
constexpr std::int64_t kDatWrap = std::int64_t{1} << 32;
constexpr std::byte kOldType{0x00}, kCdType{0x0c}, kEventBytes{8};

struct Address {
  int x_bits, y_bits, p_bit;
};
constexpr Address kVersion1{9, 8, 17}, kVersion2{14, 14, 28};
constexpr int kAtisWidth = 304, kAtisHeight = 240;

class DatReader final : public EventReader<DatReader> {
 public:
  explicit DatReader(const std::filesystem::path& path) : file_(path) {
    RawHeader header = parse_raw_header(head_of(path, kHeadBytes));
    info_ = header.info;
    file_.seek(header.bytes);
    std::byte type_and_size[2];
    file_.read_exactly(type_and_size, "event type and size");
    if ((type_and_size[0] != kOldType && type_and_size[0] != kCdType) || type_and_size[1] != kEventBytes)
      throw file_.damage(fmt::format("event type {} of {} bytes", static_cast<int>(type_and_size[0]),
                                     static_cast<int>(type_and_size[1])),
                         "type 0 or 12 of 8 bytes", 2);
    const std::string version = header.fields.contains("version") ? header.fields["version"] : found_version();
    if (version != "1" && version != "2") throw bad_input(path.string(), "Version", shortened(version, 40), "1 or 2");
    is_version_1_ = version == "1";
    if (is_version_1_ && (info_.width == 0 || info_.height == 0)) info_.width = kAtisWidth, info_.height = kAtisHeight;
    extent_.emplace(info_, kDatMaxSize);
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
    const Address& bits = is_version_1_ ? kVersion1 : kVersion2;
    event = {wraps_ + t, static_cast<std::uint16_t>(address & ((1u << bits.x_bits) - 1)),
             static_cast<std::uint16_t>(address >> bits.x_bits & ((1u << bits.y_bits) - 1)),
             static_cast<std::uint8_t>(address >> bits.p_bit & 1)};
    if (!extent_->add(event) || (is_version_1_ && address >> (kVersion1.p_bit + 1) != 0))
      throw file_.damage(fmt::format("an event at pixel ({}, {})", event.x, event.y),
                         fmt::format("{}{}", extent_->wanted(), is_version_1_ ? ", in 18 bits (version 1)" : ""), 8);
    return true;
  }

 private:
  std::string found_version() {
    const std::uint64_t begin = file_.offset();
    const auto whole = (file_.size() - begin) / 8;
    std::string version = "1";
    for (std::uint64_t i = 0; i < whole && version == "1"; ++i)
      if (*file_.next<std::uint64_t>() >> (32 + kVersion1.p_bit + 1) != 0) version = "2";
    file_.seek(begin);
    return version;
  }

  InputFile file_;
  bool is_version_1_ = false;
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
  const auto data = header.fields.find("data");  // "Data file containing CD events."
  return header.bytes > 0 && header.encoding.empty() &&
         (header.fields.contains("version") || (data != header.fields.end() && data->second.starts_with("file"))) &&
         head.size() >= header.bytes + 2 && head[header.bytes + 1] == kEventBytes;
}

}  // namespace

Codec make_dat() {
  return make_codec<DatReader, DatWriter>("dat", "Prophesee DAT, written as version 2", ".dat", kDatLimits,
                                          [](const auto&, auto head) { return is_dat(parse_raw_header(head), head); });
}

}  // namespace pecs::events
