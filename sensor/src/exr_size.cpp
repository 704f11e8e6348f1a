#include "exr_size.h"

#include <ImfChannelList.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <fstream>

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
    if (length < 0 || static_cast<std::uint64_t>(length) > bytes - std::min(bytes, at))
      throw bad_input(path.string(), fmt::format("byte {}", at - sizeof length),
                      fmt::format("attribute {} of {} bytes", shortened(name.data(), 40), length),
                      "what the file can hold");
    file.seekg(length, std::ios::cur);
  }
}

}  // namespace pecs::sensor
