#include "stack/exr_frame.h"

#include <ImfChannelList.h>
#include <ImfIntAttribute.h>
#include <ImfStringAttribute.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <mutex>
#include <string_view>

#include "pecs/text.h"

namespace pecs::sensor {

namespace fs = std::filesystem;

std::string frame_name(const Layer& layer, std::int64_t index) {
  return fmt::format("{}{:06}.exr", layer.prefix, index);
}

std::string between_name(std::int64_t interval, std::int64_t number) {
  return fmt::format("between_{:06}_{:06}.exr", interval, number);
}

std::string channel_name(double lambda_nm) {
  std::string number = fmt::format("{:.3f}", lambda_nm);
  number.erase(number.find_last_not_of('0') + 1);
  if (number.back() == '.') number.pop_back();
  std::replace(number.begin(), number.end(), '.', ',');
  return "S0." + number + "nm";
}

std::optional<double> channel_lambda_nm(std::string name) {
  const std::size_t kind = name.find_first_of("._");
  if (kind == std::string::npos || !name.ends_with("nm")) return std::nullopt;
  const std::string prefix = name.substr(0, kind);
  const bool word = name[kind] == '_' && !prefix.empty() &&
                    std::ranges::all_of(prefix, [](unsigned char c) { return std::isalpha(c) != 0; });
  if (prefix != "S0" && !word) return std::nullopt;
  name = name.substr(kind + 1, name.size() - kind - 3);
  std::replace(name.begin(), name.end(), ',', '.');
  const auto value = number_from<double>(name);
  return value && *value > 0 ? value : std::nullopt;
}

void limit_exr() {
  static std::once_flag once;
  std::call_once(once, [] {
    Imf::Header::setMaxImageSize(kMaxSide, kMaxSide);
    Imf::Header::setMaxTileSize(kMaxSide, kMaxSide);
  });
}

std::string one_line(std::string text) {
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

const Imath::Box2i& frame_window(const Imf::Header& header, bool is_foreign) {
  const bool is_pbrts = header.findTypedAttribute<Imf::IntAttribute>("samplesPerPixel") != nullptr;
  return is_foreign && !is_pbrts ? header.displayWindow() : header.dataWindow();
}

int width_of(const Imath::Box2i& window) { return window.max.x - window.min.x + 1; }
int height_of(const Imath::Box2i& window) { return window.max.y - window.min.y + 1; }

namespace {

// Finds a channel by name, or by wavelength, whose digits may differ in files of other writers. Empty if there is none.
std::string channel_in(const Imf::ChannelList& channels, const std::string& wanted) {
  if (channels.findChannel(wanted)) return wanted;
  if (const auto lambda = channel_lambda_nm(wanted))
    for (auto c = channels.begin(); c != channels.end(); ++c)
      if (const auto found = channel_lambda_nm(c.name()); found && std::abs(*found - *lambda) < kSameLambda_nm)
        return c.name();
  return "";
}

}  // namespace

std::vector<std::string> check_header(const Imf::Header& header, const fs::path& path, const StackInfo& info,
                                      const Layer& layer, bool is_foreign) {
  const Imath::Box2i& window = frame_window(header, is_foreign);
  const int width = width_of(window), height = height_of(window);
  if (width != info.file_width() || height != info.file_height())
    throw bad_input(path.string(), &window == &header.displayWindow() ? "displayWindow" : "dataWindow",
                    fmt::format("{}x{}", width, height), fmt::format("{}x{}", info.file_width(), info.file_height()));
  if (std::abs(header.pixelAspectRatio() - 1) > 1e-3)
    throw bad_input(path.string(), "pixelAspectRatio", fmt::format("{:.4g}", header.pixelAspectRatio()),
                    "1 (square pixels: resample the frames)");
  std::vector<std::string> names;
  for (const std::string& wanted : layer.channels) {
    const std::string name = channel_in(header.channels(), wanted);
    if (name.empty()) {
      int others = 0;
      for (auto c = header.channels().begin(); c != header.channels().end(); ++c) ++others;
      throw bad_input(path.string(), "channels", fmt::format("{} others", others), wanted);
    }
    const Imf::Channel& channel = header.channels()[name];
    if (channel.xSampling != 1 || channel.ySampling != 1)
      throw bad_input(path.string(), name, "a subsampled channel", "one value per pixel");
    names.push_back(name);
  }
  return names;
}

std::int64_t time_of(const Imf::Header& header, const fs::path& path) {
  const auto* time = header.findTypedAttribute<Imf::StringAttribute>(kTimeAttribute);
  const std::string text = time ? time->value() : "";
  const auto value = number_from<std::int64_t>(text);
  if (!value || *value < 0 || *value > std::int64_t{1} << 61)
    throw bad_input(path.string(), kTimeAttribute, text.empty() ? "nothing" : text.substr(0, 40),
                    "integer nanoseconds, 0 to 2^61");
  return *value;
}

void check_time(const Imf::Header& header, const fs::path& path, std::int64_t time_ns, bool required,
                std::int64_t tolerance_ns) {
  if (header.findTypedAttribute<Imf::StringAttribute>(kTimeAttribute)) {
    if (const std::int64_t got_ns = time_of(header, path);
        got_ns < time_ns - tolerance_ns || got_ns > time_ns + tolerance_ns)
      throw bad_input(path.string(), kTimeAttribute, std::to_string(got_ns),
                      fmt::format("{}{}", time_ns, tolerance_ns ? ", by --fps or --times" : ""));
  } else if (required) {
    throw bad_input(path.string(), kTimeAttribute, "nothing", std::to_string(time_ns));
  }
}

Imf::FrameBuffer frame_buffer(std::span<const std::string> channels, float* values, int width, int rows, int min_x,
                              int first_row) {
  Imf::FrameBuffer buffer;
  const std::size_t plane = static_cast<std::size_t>(width) * static_cast<std::size_t>(rows);
  for (std::size_t b = 0; b < channels.size(); ++b) {
    // OpenEXR takes the address of pixel (0, 0), which may be outside the array.
    float* origin = values + b * plane;
    char* base = reinterpret_cast<char*>(origin) -
                 (static_cast<std::ptrdiff_t>(min_x) + static_cast<std::ptrdiff_t>(first_row) * width) *
                     static_cast<std::ptrdiff_t>(sizeof(float));
    buffer.insert(channels[b],
                  Imf::Slice(Imf::FLOAT, base, sizeof(float), sizeof(float) * static_cast<std::size_t>(width)));
  }
  return buffer;
}

namespace {

// Upper limit of the compression ratio: 1032 for DEFLATE, 11 for B44A, 64 for run lengths; wavelets and cosines
// compress constant pictures almost without limit.
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

// OpenEXR reads as many bytes as the type has, whatever length is declared; with another length it misreads what
// follows. https://openexr.com/en/latest/OpenEXRFileLayout.html#predefined-attribute-types
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

// Whether the lengths inside a value add up to its length.
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
  if (!file || ec) return;  // OpenEXR reports why
  file.seekg(8);            // magic number and version
  // Attributes have name, type and length; an empty name ends the header. Only the first part of a file is checked.
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
