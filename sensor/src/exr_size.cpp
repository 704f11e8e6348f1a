#include "exr_size.h"

#include <ImfChannelList.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string>
#include <string_view>

#include "pecs/error.h"

namespace pecs::sensor {
namespace {

// The most that a byte of the file can stand for: DEFLATE ends at 1032, B44A at 11, run lengths at 64; the wavelets and
// cosines of the others spend next to nothing on a constant picture.
std::uint64_t most_packed(Imf::Compression compression) {
  switch (compression) {
    case Imf::NO_COMPRESSION:
      return 1;
    case Imf::RLE_COMPRESSION:
    case Imf::ZIPS_COMPRESSION:
    case Imf::ZIP_COMPRESSION:
    case Imf::PXR24_COMPRESSION:
    case Imf::B44_COMPRESSION:
    case Imf::B44A_COMPRESSION:
      return 1100;
    default:
      return 1 << 16;
  }
}

// OpenEXR reads these as their types say, whatever length is declared: what follows is read from another place then.
// https://openexr.com/en/latest/OpenEXRFileLayout.html#predefined-attribute-types
struct FixedType {
  std::string_view name;
  std::int32_t bytes;
};
constexpr FixedType kFixedTypes[] = {{"box2f", 16},
                                     {"box2i", 16},
                                     {"chromaticities", 32},
                                     {"compression", 1},
                                     {"deepImageState", 1},
                                     {"double", 8},
                                     {"envmap", 1},
                                     {"float", 4},
                                     {"int", 4},
                                     {"keycode", 28},
                                     {"lineOrder", 1},
                                     {"m33d", 72},
                                     {"m33f", 36},
                                     {"m44d", 128},
                                     {"m44f", 64},
                                     {"rational", 8},
                                     {"tiledesc", 9},
                                     {"timecode", 8},
                                     {"v2d", 16},
                                     {"v2f", 8},
                                     {"v2i", 8},
                                     {"v3d", 24},
                                     {"v3f", 12},
                                     {"v3i", 12}};
constexpr std::string_view kParts[] = {"chlist", "preview", "stringvector"};

std::uint32_t number_at(std::string_view value, std::size_t at) {
  std::uint32_t number = 0;
  std::memcpy(&number, value.data() + at, sizeof number);
  return number;
}

// Whether what a value says of its own length is its length.
bool ends_with_its_parts(std::string_view type, std::string_view value) {
  if (type == "preview")
    return value.size() >= 8 && (value.size() - 8) % 4 == 0 &&
           std::uint64_t{number_at(value, 0)} * number_at(value, 4) == (value.size() - 8) / 4;
  std::size_t at = 0;
  if (type == "stringvector") {
    while (at + 4 <= value.size() && number_at(value, at) <= value.size() - at - 4) at += 4 + number_at(value, at);
    return at == value.size();
  }
  constexpr std::size_t kChannelBytes = 16;  // after its name
  while (at < value.size() && value[at]) {
    const std::size_t end = value.find('\0', at);
    if (end == std::string_view::npos) return false;
    at = end + 1 + kChannelBytes;
  }
  return at + 1 == value.size();
}

}  // namespace

void check_declared_size(const Imf::Header& header, const std::filesystem::path& path) {
  const Imath::Box2i& box = header.dataWindow();
  const auto side = [](int min, int max) { return static_cast<std::uint64_t>(std::int64_t{max} - min + 1); };
  std::uint64_t pixel_bytes = 0;
  for (auto c = header.channels().begin(); c != header.channels().end(); ++c)
    if (c.channel().xSampling == 1 && c.channel().ySampling == 1) pixel_bytes += c.channel().type == Imf::HALF ? 2 : 4;
  const std::uint64_t declared = side(box.min.x, box.max.x) * side(box.min.y, box.max.y) * pixel_bytes;
  const std::uint64_t bytes = std::filesystem::file_size(path);
  if (declared > bytes * most_packed(header.compression()))
    throw bad_input(path.string(), "dataWindow", fmt::format("{} bytes of pixels in a file of {}", declared, bytes),
                    "what the file can hold");
}

void check_attributes(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::error_code ec;
  const std::uint64_t bytes = std::filesystem::file_size(path, ec);
  if (!file || ec) return;  // OpenEXR says why
  file.seekg(8);            // magic number and version
  // A name, a type and a length each, until an empty name ends the header; of several parts, the first is read.
  std::array<char, 257> name{}, type{};
  while (file.getline(name.data(), name.size(), '\0') && name[0] && file.getline(type.data(), type.size(), '\0')) {
    std::int32_t length = 0;
    if (!file.read(reinterpret_cast<char*>(&length), sizeof length)) return;
    const std::uint64_t at = static_cast<std::uint64_t>(file.tellg());
    const auto refuse = [&](const char* wanted) {
      throw bad_input(path.string(), fmt::format("byte {}", at - sizeof length),
                      fmt::format("attribute {} of {} bytes", shortened(name.data(), 40), length), wanted);
    };
    if (length < 0 || static_cast<std::uint64_t>(length) > bytes - std::min(bytes, at))
      refuse("what the file can hold");
    const std::string_view kind = type.data();
    const auto* const fixed = std::ranges::find(kFixedTypes, kind, &FixedType::name);
    if (fixed != std::end(kFixedTypes) && fixed->bytes != length) refuse("its type's length");
    std::string value(std::ranges::find(kParts, kind) != std::end(kParts) ? static_cast<std::size_t>(length) : 0, '\0');
    file.read(value.data(), static_cast<std::streamsize>(value.size()));
    if (!value.empty() && !ends_with_its_parts(kind, value)) refuse("parts of that length in all");
    file.seekg(static_cast<std::streamoff>(at) + length);
  }
}

}  // namespace pecs::sensor
