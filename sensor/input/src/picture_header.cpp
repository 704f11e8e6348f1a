#include "picture_header.h"

#include <libdeflate.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <memory>
#include <sstream>
#include <string>

namespace pecs::input {
namespace {

class Bytes {
 public:
  explicit Bytes(const std::filesystem::path& path) : file_(path, std::ios::binary) {}

  // `size` bytes from `at` on, zeros beyond the end.
  std::string text(std::uint64_t at, std::size_t size) {
    std::string out(size, '\0');
    file_.clear();
    file_.seekg(static_cast<std::streamoff>(at));
    file_.read(out.data(), static_cast<std::streamsize>(size));
    return out;
  }
  std::uint32_t number(std::uint64_t at, std::size_t size, bool big) {
    const std::string bytes = text(at, size);
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < size; ++i)
      value = value << 8 | static_cast<unsigned char>(bytes[big ? i : size - 1 - i]);
    return value;
  }

 private:
  std::ifstream file_;
};

// Aspect ratio of a pixel from pixels per length; 0: not stated.
double aspect_of(double per_width, double per_height) {
  return per_width > 0 && per_height > 0 ? per_height / per_width : 1;
}

constexpr int kMostParts = 1000;  // chunks, segments or entries that precede the picture
constexpr std::size_t kMostProfile = std::size_t{1} << 22;

// Primaries and transfer curve by their numbers in ITU-T H.273. BT.601's primaries are nearly those of BT.709.
void read_cicp(int primaries, int transfer, PictureHeader& out) {
  out.transfer = transfer;
  out.other_primaries = primaries != 1 && primaries != 2 && primaries != 5 && primaries != 6;
}

// Of an ICC profile (ISO 15076-1, ICC.1:2022): the exponent of its curve at half of the values, that of green or of
// grey, its primaries, and what its tag cicp names.
void read_icc(std::string_view icc, PictureHeader& out) {
  const auto number = [&](std::size_t at, std::size_t size) {
    std::uint32_t value = 0;
    for (std::size_t i = at; i < at + size; ++i)
      value = value << 8 | (i < icc.size() ? static_cast<unsigned char>(icc[i]) : 0u);
    return value;
  };
  const auto fixed = [&](std::size_t at) { return static_cast<std::int32_t>(number(at, 4)) / 65536.0; };
  const auto is = [&](std::size_t at, std::string_view name) { return at < icc.size() && icc.substr(at, 4) == name; };
  struct Primary {
    const char* name;
    double x, y, z;  // by D50
  };
  static constexpr Primary kSrgb[] = {
      {"rXYZ", 0.4361, 0.2225, 0.0139}, {"gXYZ", 0.3851, 0.7169, 0.0971}, {"bXYZ", 0.1431, 0.0606, 0.7141}};
  constexpr double kSame = 0.03;
  for (std::size_t tag = 132; tag < 132 + 12 * std::min(100u, number(128, 4)); tag += 12) {
    const std::size_t at = number(tag + 4, 4), count = number(at + 8, 4);
    if (is(at, "cicp")) read_cicp(static_cast<int>(number(at + 8, 1)), static_cast<int>(number(at + 9, 1)), out);
    for (const auto& [name, x, y, z] : kSrgb)
      if (is(tag, name) && is(at, "XYZ "))
        out.other_primaries |=
            std::max({std::abs(fixed(at + 8) - x), std::abs(fixed(at + 12) - y), std::abs(fixed(at + 16) - z)}) > kSame;
    if (!is(tag, "gTRC") && !is(tag, "kTRC")) continue;
    double half = 0;  // the curve's value at one half
    if (is(at, "para")) {
      const std::uint32_t kind = number(at + 8, 2);
      const double a = kind > 0 ? fixed(at + 16) : 1, b = kind > 0 ? fixed(at + 20) : 0;
      const double added = kind == 2 ? fixed(at + 24) : kind == 4 ? fixed(at + 32) : 0;
      half = std::pow(std::max(0.0, 0.5 * a + b), fixed(at + 12)) + added;
    } else if (is(at, "curv") && count < 2) {
      out.gamma = count == 0 ? 1 : number(at + 12, 2) / 256.0;
    } else if (is(at, "curv")) {
      half = (number(at + 12 + (count - 1) / 2 * 2, 2) + number(at + 12 + count / 2 * 2, 2)) / 131070.0;
    }
    if (half > 0 && half < 1) out.gamma = std::log(half) / std::log(0.5);
  }
}

// A name, a zero, the method and the profile, compressed.
std::string icc_of_png(std::string_view chunk) {
  const std::size_t name = chunk.find('\0');
  if (name == std::string_view::npos || name + 2 > chunk.size()) return {};
  const std::string_view packed = chunk.substr(name + 2);
  const std::unique_ptr<libdeflate_decompressor, decltype(&libdeflate_free_decompressor)> inflate(
      libdeflate_alloc_decompressor(), &libdeflate_free_decompressor);
  std::string out(std::min(kMostProfile, 1100 * chunk.size()), '\0');
  std::size_t got = 0;
  libdeflate_zlib_decompress(inflate.get(), packed.data(), packed.size(), out.data(), out.size(), &got);
  out.resize(got);
  return out;
}

PictureHeader of_png(Bytes& file) {
  PictureHeader out;
  out.alpha = file.number(25, 1, true) & 4;  // colour types 4 and 6
  std::uint64_t at = 8;
  for (int i = 0; i < kMostParts; ++i) {
    const std::uint32_t size = file.number(at, 4, true);
    const std::string type = file.text(at + 4, 4);
    if (type == "IDAT" || type == "IEND") break;
    out.alpha |= type == "tRNS";
    out.pages |= type == "acTL";  // animated
    if (type == "gAMA" && out.gamma == 0) out.gamma = 1e5 / std::max(1u, file.number(at + 8, 4, true));
    if (type == "iCCP" && size < kMostProfile) read_icc(icc_of_png(file.text(at + 8, size)), out);
    if (type == "cICP")
      read_cicp(static_cast<int>(file.number(at + 8, 1, true)), static_cast<int>(file.number(at + 9, 1, true)), out);
    if (type == "pHYs") out.pixel_aspect = aspect_of(file.number(at + 8, 4, true), file.number(at + 12, 4, true));
    at += 12 + std::uint64_t{size};
  }
  return out;
}

// TIFF 6.0: the entries of the first directory. Exif has the same in a JPEG file, from `start` on.
PictureHeader of_tiff(Bytes& file, std::uint64_t start = 0) {
  constexpr int kWidth = 256, kHeight = 257, kPhotometric = 262, kOrientation = 274, kXResolution = 282,
                kYResolution = 283, kExtraSamples = 338, kProfile = 34675;
  const bool big = file.text(start, 2) == "MM";
  const auto entries_of = [&](std::uint64_t directory) { return file.number(directory, 2, big); };
  const auto size_of = [&](std::uint64_t directory) {
    std::array<std::uint32_t, 2> size{};
    for (std::uint64_t i = 0; i < entries_of(directory) && i < kMostParts; ++i)
      if (const std::uint64_t at = directory + 2 + 12 * i, tag = file.number(at, 2, big);
          tag == kWidth || tag == kHeight)
        size[tag - kWidth] = file.number(at + 8, file.number(at + 2, 2, big) == 3 ? 2 : 4, big);
    return size;
  };
  const std::uint64_t directory = start + file.number(start + 4, 4, big);
  const std::uint32_t entries = entries_of(directory);
  PictureHeader out;
  std::array<double, 2> per_length{};
  for (std::uint64_t i = 0; i < entries && i < kMostParts; ++i) {
    const std::uint64_t at = directory + 2 + 12 * i;
    const std::uint32_t tag = file.number(at, 2, big);
    out.alpha |= tag == kExtraSamples;
    out.turned |= tag == kOrientation && file.number(at + 8, 2, big) > 1;
    if (const std::size_t size = file.number(at + 4, 4, big); tag == kProfile && size < kMostProfile)
      read_icc(file.text(start + file.number(at + 8, 4, big), size), out);
    out.white_is_zero |= tag == kPhotometric && file.number(at + 8, 2, big) == 0;
    if (tag != kXResolution && tag != kYResolution) continue;
    const std::uint64_t rational = start + file.number(at + 8, 4, big);
    const double below = file.number(rational + 4, 4, big);
    per_length[tag - kXResolution] = below > 0 ? file.number(rational, 4, big) / below : 0;
  }
  out.pixel_aspect = aspect_of(per_length[0], per_length[1]);
  const std::uint32_t next = file.number(directory + 2 + 12 * std::uint64_t{entries}, 4, big);
  out.pages = next > 0 && size_of(start + next) == size_of(directory);
  return out;
}

// "P5", width, height and the greatest value, with comments from # to the end of a line.
PictureHeader of_pnm(Bytes& file) {
  constexpr std::size_t kMostHeader = 4096;
  std::string head = file.text(0, kMostHeader);
  for (std::size_t at = 0; (at = head.find('#')) != std::string::npos;) head.erase(at, head.find('\n', at) - at);
  std::istringstream words(head.substr(2));
  int width = 0, height = 0;
  PictureHeader out;
  words >> width >> height >> out.white;
  return out;
}

PictureHeader of_jpeg(Bytes& file) {
  PictureHeader out;
  std::uint64_t at = 2;
  for (int i = 0; i < kMostParts && file.number(at, 1, true) == 0xff; ++i) {
    const std::uint32_t kind = file.number(at + 1, 1, true);
    if (kind == 0xda) break;  // start of scan
    if (kind == 0xe0 && file.text(at + 4, 5) == std::string("JFIF\0", 5))
      out.pixel_aspect = aspect_of(file.number(at + 12, 2, true), file.number(at + 14, 2, true));
    if (kind == 0xe1 && file.text(at + 4, 4) == "Exif" && out.pixel_aspect == 1)
      out.pixel_aspect = of_tiff(file, at + 10).pixel_aspect;
    if (kind == 0xe2 && file.text(at + 4, 12) == std::string("ICC_PROFILE\0", 12) && out.gamma == 0)  // its first part
      read_icc(file.text(at + 18, file.number(at + 2, 2, true)), out);
    at += 2 + file.number(at + 2, 2, true);
  }
  return out;
}

PictureHeader of_webp(Bytes& file) {
  const std::string kind = file.text(12, 4);
  PictureHeader out{.alpha = (kind == "VP8X" && file.number(20, 1, false) & 0x10) ||
                             (kind == "VP8L" && file.number(24, 1, false) & 0x10)};
  std::uint64_t at = 12;
  for (int i = 0; i < kMostParts && kind == "VP8X"; ++i) {
    const std::string type = file.text(at, 4);
    const std::uint32_t size = file.number(at + 4, 4, false);
    if (type == std::string(4, '\0')) break;
    const std::uint64_t exif = at + 8 + (file.text(at + 8, 4) == "Exif" ? 6 : 0);
    if (type == "EXIF") out.turned = of_tiff(file, exif).turned;
    if (type == "ICCP") read_icc(file.text(at + 8, std::min<std::size_t>(size, kMostProfile)), out);
    at += 8 + std::uint64_t{size} + size % 2;
  }
  return out;
}

}  // namespace

PictureHeader picture_header(const std::filesystem::path& path) {
  Bytes file(path);
  const std::string head = file.text(0, 12);
  if (head.starts_with("\x89PNG")) return of_png(file);
  if (head.starts_with(std::string("II*\0", 4)) || head.starts_with(std::string("MM\0*", 4))) {
    PictureHeader out = of_tiff(file);
    out.turned = false;  // OpenCV turns it
    return out;
  }
  if (head.starts_with("\xff\xd8")) return of_jpeg(file);
  if (head.starts_with("BM")) return {aspect_of(file.number(38, 4, false), file.number(42, 4, false))};
  if (head[0] == 'P' && std::string("2356").find(head[1]) != std::string::npos) return of_pnm(file);
  if (head.starts_with("RIFF") && head.ends_with("WEBP")) return of_webp(file);
  return {};
}

}  // namespace pecs::input
