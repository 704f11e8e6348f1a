// AEDAT 2.0 of jAER and v2e: header lines that begin with '#', then per sample two 32-bit big-endian words, address and
// t_us modulo 2^32. Addresses of DAVIS cameras: bit 31 set: a sample of a frame or of the IMU; bit 10 set: external
// input; else an event with y from below in bits 30..22, x from the right in bits 21..12 and p in bit 11 (jAER's
// DavisBaseCamera). The header names the chip; v2e's has no chip, and is read as the DAVIS346 that v2e writes by
// default.
#include <fmt/format.h>

#include <array>

#include "codec.h"
#include "input_file.h"
#include "pecs/text.h"

namespace pecs::events {
namespace {

constexpr std::string_view kMagic = "#!AER-DAT2.0";
constexpr std::string_view kChipKey = "# AEChip:";
constexpr std::size_t kMaxChipLine = 200;
constexpr std::int64_t kAedat2Wrap = std::int64_t{1} << 32;
constexpr std::uint32_t kOtherSample = 1u << 31, kExternal = 1u << 10;

struct ChipSize {
  std::string_view name;
  int width, height;
};
constexpr std::array kChips = {ChipSize{"davis346", 346, 260}, ChipSize{"davis240", 240, 180},
                               ChipSize{"davis640", 640, 480}};

class Aedat2Reader final : public EventReader<Aedat2Reader> {
 public:
  explicit Aedat2Reader(const std::filesystem::path& path) : file_(path) {
    info_ = {kChips[0].width, kChips[0].height, ""};
    read_header();
    extent_.emplace(info_, 1024);
  }

  std::string place() const override { return fmt::format("byte {}", file_.offset() - 8); }

  bool next(Event& event) {
    while (const auto item = file_.next<std::uint64_t>()) {
      const std::uint64_t words = __builtin_bswap64(*item);
      const auto t = static_cast<std::int64_t>(words & 0xffffffff);
      const auto address = static_cast<std::uint32_t>(words >> 32);
      if (address & (kOtherSample | kExternal)) continue;
      // A decrease of t by half its range or more is a wrap.
      if (t + kAedat2Wrap / 2 <= last_) wraps_ += kAedat2Wrap;
      last_ = t;
      const int x = info_.width - 1 - static_cast<int>(address >> 12 & 0x3ff);
      const int y = info_.height - 1 - static_cast<int>(address >> 22 & 0x1ff);
      if (x < 0 || y < 0) throw file_.damage(fmt::format("an event at pixel ({}, {})", x, y), extent_->wanted(), 8);
      event = {wraps_ + t, static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y),
               static_cast<std::uint8_t>(address >> 11 & 1)};
      extent_->add(event);
      return true;
    }
    return false;
  }

 private:
  void read_header() {
    std::uint64_t data = 0;
    for (std::optional<char> c; (c = file_.next<char>()) && *c == '#'; data = file_.offset()) {
      std::string line;
      for (; c && *c != '\n'; c = file_.next<char>())
        if (line.size() < kMaxChipLine) line += *c;
      if (line.starts_with(kChipKey)) set_chip(line);
    }
    file_.seek(data);
  }

  void set_chip(const std::string& line) {
    info_.camera = line.substr(line.find_last_of(". ") + 1);
    while (!info_.camera.empty() && info_.camera.back() == '\r') info_.camera.pop_back();
    for (const ChipSize& chip : kChips)
      if (lower(info_.camera).starts_with(chip.name)) {
        info_.width = chip.width;
        info_.height = chip.height;
        return;
      }
    throw bad_input(file_.path().string(), "AEChip", shortened(info_.camera, 40), "Davis240, Davis346 or Davis640");
  }

  InputFile file_;
  std::int64_t last_ = 0, wraps_ = 0;
};

}  // namespace

Codec make_aedat2() {
  return {.name = "aedat2",
          .description = "AEDAT 2.0 of DAVIS cameras, jAER and v2e",
          .extensions = {".aedat", ".aedat2"},
          .sniff = [](const auto&, auto head) { return begins_with(head, kMagic); },
          .open_reader = [](const auto& path) { return std::make_unique<Aedat2Reader>(path); },
          .open_writer = {},
          .limits = {}};
}

}  // namespace pecs::events
