#include "exr_frame.h"

#include <ImfChannelList.h>
#include <ImfStringAttribute.h>
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <mutex>

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
  double value = 0;
  const auto [end, ec] = std::from_chars(name.data(), name.data() + name.size(), value);
  if (ec != std::errc() || end != name.data() + name.size() || !(value > 0)) return std::nullopt;
  return value;
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

int width_of(const Imf::Header& header) {
  const Imath::Box2i& box = header.dataWindow();
  return box.max.x - box.min.x + 1;
}

int height_of(const Imf::Header& header) {
  const Imath::Box2i& box = header.dataWindow();
  return box.max.y - box.min.y + 1;
}

namespace {

// By name, or by wavelength: other writers may print it with other digits. Empty where there is none.
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
                                      const Layer& layer) {
  const int width = width_of(header), height = height_of(header);
  if (width != info.file_width() || height != info.file_height())
    throw bad_input(path.string(), "dataWindow", fmt::format("{}x{}", width, height),
                    fmt::format("{}x{}", info.file_width(), info.file_height()));
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
  std::int64_t value = 0;
  const auto [stop, ec] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (ec != std::errc() || stop != text.data() + text.size())
    throw bad_input(path.string(), kTimeAttribute, text.empty() ? "nothing" : text.substr(0, 40),
                    "integer nanoseconds");
  return value;
}

void check_time(const Imf::Header& header, const fs::path& path, std::int64_t time_ns, bool required) {
  if (const auto* time = header.findTypedAttribute<Imf::StringAttribute>(kTimeAttribute)) {
    if (time->value() != std::to_string(time_ns))
      throw bad_input(path.string(), kTimeAttribute, time->value().substr(0, 40), std::to_string(time_ns));
  } else if (required) {
    throw bad_input(path.string(), kTimeAttribute, "nothing", std::to_string(time_ns));
  }
}

Imf::FrameBuffer frame_buffer(std::span<const std::string> channels, float* values, int width, int rows, int min_x,
                              int first_row) {
  Imf::FrameBuffer buffer;
  const std::size_t plane = static_cast<std::size_t>(width) * static_cast<std::size_t>(rows);
  for (std::size_t b = 0; b < channels.size(); ++b) {
    // OpenEXR wants the address of pixel (0, 0), which may lie outside the array.
    float* origin = values + b * plane;
    char* base = reinterpret_cast<char*>(origin) -
                 (static_cast<std::ptrdiff_t>(min_x) + static_cast<std::ptrdiff_t>(first_row) * width) *
                     static_cast<std::ptrdiff_t>(sizeof(float));
    buffer.insert(channels[b],
                  Imf::Slice(Imf::FLOAT, base, sizeof(float), sizeof(float) * static_cast<std::size_t>(width)));
  }
  return buffer;
}

}  // namespace pecs::sensor
