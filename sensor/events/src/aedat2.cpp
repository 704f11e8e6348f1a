// AEDAT 2.0 of jAER and v2e: header lines that begin with '#', then per sample two 32-bit big-endian words, address and
// t_us modulo 2^32. Addresses by camera (jAER's DavisBaseCamera, DVS128, DVS640), x from the right and y from below:
//   DAVIS   bit 31 set: a sample of a frame or of the IMU; bit 10 set: external input; else y in bits 30..22, x
//   in 21..12,
//           p in bit 11
//   DVS128  bit 15 set: external input; else y in bits 14..8, x in 7..1, bit 0 set for OFF
//   DVS640  y in bits 20..11, x in 10..1, p in bit 0: as v2e writes 640x480
// A header line is printable text up to a line end; data may also begin with '#'. The camera is the header's AEChip. A
// file without one: addresses of 15 bits are a DVS128's; else the user states the size, except for files of v2e that
// only 346x260 or 640x480 explains.
#include <fmt/format.h>

#include <array>
#include <cctype>

#include "codec.h"
#include "input_file.h"
#include "pecs/text.h"

namespace pecs::events {
namespace {

constexpr std::string_view kAedat2Magic = "#!AER-DAT2.0", kChipKey = "# AEChip:", kHeaderEnd = "#End Of ASCII Header";
constexpr std::size_t kAedat2Line = 4096;
constexpr std::int64_t kAedat2Wrap = std::int64_t{1} << 32;

struct Bits {
  int shift;
  std::uint32_t mask;
  int of(std::uint32_t address) const { return static_cast<int>(address >> shift & mask); }
};
struct Camera {
  std::string_view name;  // of its chip, lower case, or the beginning of it
  int width, height;
  Bits x, y;
  int p_bit;
  bool off_is_1;
  std::uint32_t others;  // addresses with one of these bits are no events
};
constexpr Camera davis(std::string_view name, int width, int height) {
  return {name, width, height, {12, 0x3ff}, {22, 0x1ff}, 11, false, 1u << 31 | 1u << 10};
}
constexpr Camera dvs128(std::string_view name) { return {name, 128, 128, {1, 0x7f}, {8, 0x7f}, 0, true, ~0x7fffu}; }
constexpr std::array kCameras = {davis("davis346", 346, 260),
                                 davis("davis240", 240, 180),
                                 davis("davis640", 640, 480),
                                 davis("davisrgbw640", 640, 480),
                                 dvs128("dvs128"),
                                 dvs128("tmpdiff128"),
                                 Camera{"dvs640", 640, 480, {1, 0x3ff}, {11, 0x3ff}, 0, false, ~0x1fffffu}};

const Camera* camera_named(std::string_view name) {
  const auto* const found = std::ranges::find_if(kCameras, [&](const Camera& c) { return name.starts_with(c.name); });
  return found == kCameras.end() ? nullptr : found;
}

class Aedat2Reader final : public EventReader<Aedat2Reader> {
 public:
  Aedat2Reader(const std::filesystem::path& path, const ReadOptions& options) : file_(path) {
    read_header();
    if (!info_.camera.empty()) {
      const Camera* found = camera_named(lower(info_.camera));
      if (!found)
        throw bad_input(path.string(), "AEChip", shortened(info_.camera, 40),
                        "DVS128, Davis240, Davis346, Davis640 or DVS640");
      camera_ = *found;
    } else {
      camera_ = camera_of(options);
    }
    info_.width = camera_.width;
    info_.height = camera_.height;
    extent_.emplace(info_, 1024);
  }

  std::string place() const override { return fmt::format("byte {}", file_.offset() - 8); }

  bool next(Event& event) {
    while (const auto item = file_.next<std::uint64_t>()) {
      const std::uint64_t words = __builtin_bswap64(*item);
      const auto t = static_cast<std::int64_t>(words & 0xffffffff);
      const auto address = static_cast<std::uint32_t>(words >> 32);
      if (address & camera_.others) continue;
      // A decrease of t by half its range or more is a wrap.
      if (t + kAedat2Wrap / 2 <= last_) wraps_ += kAedat2Wrap;
      last_ = t;
      const int x = info_.width - 1 - camera_.x.of(address), y = info_.height - 1 - camera_.y.of(address);
      if (x < 0 || y < 0) throw file_.damage(fmt::format("an event at pixel ({}, {})", x, y), extent_->wanted(), 8);
      const bool bit = address >> camera_.p_bit & 1;
      event = {wraps_ + t, static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), bit != camera_.off_is_1};
      extent_->add(event);
      return true;
    }
    return false;
  }

 private:
  void read_header() {
    std::uint64_t data = 0;
    for (std::optional<std::string> line; (line = header_line()); data = file_.offset()) {
      if (data == 0 && !line->starts_with(kAedat2Magic)) break;
      if (line->starts_with(kChipKey)) info_.camera = line->substr(line->find_last_of(". ") + 1);
      if (line->find("AEDat2Output in v2e") != std::string::npos) by_v2e_ = true;
      if (line->starts_with(kHeaderEnd)) {
        data = file_.offset();
        break;
      }
    }
    if (data == 0) throw bad_input(file_.path().string(), "byte 0", "another first line", std::string(kAedat2Magic));
    file_.seek(data);
  }

  // Without its end; none if no line of a header begins here.
  std::optional<std::string> header_line() {
    if (file_.offset() == file_.size()) return {};
    std::string line;
    for (auto c = file_.next<char>(); c && line.size() < kAedat2Line; c = file_.next<char>()) {
      if (*c == '\n') {
        if (line.ends_with('\r')) line.pop_back();
        return line.starts_with('#') ? std::optional(line) : std::nullopt;
      }
      const auto byte = static_cast<unsigned char>(*c);
      if (byte < 0x20 && byte != '\t' && byte != '\r') return {};
      line += *c;
    }
    return {};
  }

  Camera camera_of(const ReadOptions& options) {
    const std::uint64_t begin = file_.offset();
    std::uint32_t used = 0;
    int x = 0, y = 0;  // most, for a DAVIS
    for (std::uint64_t i = 0, whole = (file_.size() - begin) / 8; i < whole; ++i) {
      const auto address = static_cast<std::uint32_t>(__builtin_bswap64(*file_.next<std::uint64_t>()) >> 32);
      if (address & kCameras[0].others && address >> 21) continue;
      used |= address;
      x = std::max(x, kCameras[0].x.of(address));
      y = std::max(y, kCameras[0].y.of(address));
    }
    file_.seek(begin);
    const bool is_davis = (used & 0x3ff) == 0;  // its events have 0 there
    if (options.width > 0) {
      for (const Camera& camera : kCameras)
        if (camera.width == options.width && camera.height == options.height &&
            (camera.width == 128 || is_davis == (camera.y.shift == 22)))
          return camera;
      throw bad_input(file_.path().string(), "size", fmt::format("{}x{}", options.width, options.height),
                      "128x128, 240x180, 346x260 or 640x480, whose addresses are these");
    }
    if (used < 1u << 15 && used > 0) return *camera_named("dvs128");
    if (by_v2e_ && !is_davis && used < 1u << 21) return *camera_named("dvs640");
    if (by_v2e_ && is_davis && (x >= 240 || y >= 180) && x < 346 && y < 260) return *camera_named("davis346");
    throw bad_input(file_.path().string(), "AEChip", "no camera in the header",
                    "--size WIDTH HEIGHT: 240 180, 346 260 or 640 480 (in Python size)");
  }

  InputFile file_;
  Camera camera_ = kCameras[0];
  bool by_v2e_ = false;
  std::int64_t last_ = 0, wraps_ = 0;
};

}  // namespace

Codec make_aedat2() {
  return {.name = "aedat2",
          .description = "AEDAT 2.0 of DAVIS and DVS128 cameras, jAER and v2e",
          .extensions = {".aedat", ".aedat2"},
          .sniff = [](const auto&, auto head) { return begins_with(head, kAedat2Magic); },
          .open_reader = open_file<Aedat2Reader>,
          .open_writer = {},
          .limits = {}};
}

}  // namespace pecs::events
