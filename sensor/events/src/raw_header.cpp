#include "raw_header.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstring>
#include <string_view>
#include <tuple>
#include <utility>

#include "pecs/error.h"
#include "pecs/text.h"

namespace pecs::events {
namespace {

int pixels(std::string_view text) {
  const int value = number_from<int>(text).value_or(0);
  return value > 0 && value <= 65536 ? value : 0;
}

std::string_view trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(" \t\r");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

// The sensor's generation as the header has it ("3.1", "31_fx3"), in any of its lines.
std::vector<std::string_view> generations(std::map<std::string, std::string>& fields) {
  constexpr std::string_view kPlugin = "hal_plugin_gen";
  std::vector<std::string_view> found = {fields["sensor_generation"], fields["generation"]};
  if (const std::string_view plugin = fields["plugin_name"]; plugin.starts_with(kPlugin))
    found.push_back(plugin.substr(kPlugin.size()));
  return found;
}

// The sensor's size by the camera that the header names, where there is no geometry (before Metavision 2.1, or edited):
// its plugin ("hal_plugin_gen31_fx3"), generation ("3.1") or the number of its system. 0x0 when none is known. Source:
// OpenEB's hal_psee_plugins (device_system_id.h, PseeRawFileHeader, and raw_constants.h of OpenEB 2).
std::pair<int, int> size_of_camera(std::map<std::string, std::string>& fields) {
  constexpr std::pair<int, int> kVga{640, 480}, kHd{1280, 720}, kGenx{320, 320};
  for (const char* integrator : {"camera_integrator_name", "integrator_name"})
    if (!fields[integrator].empty() && fields[integrator] != "Prophesee") return {};  // numbers of its own
  const auto of_generation = [&](std::string_view text) -> std::pair<int, int> {
    if (text.starts_with("320") || text.starts_with("x320")) return kGenx;
    return text.starts_with('3') ? kVga : text.starts_with('4') ? kHd : std::pair(0, 0);
  };
  for (const std::string_view generation : generations(fields))
    if (const auto size = of_generation(generation); size.first > 0) return size;
  static const std::map<int, std::pair<int, int>> kSystems = [&] {
    std::map<int, std::pair<int, int>> sizes;
    for (const int id : {0x15, 0x17, 0x19, 0x1c, 0x1d, 0x21, 0x22, 0x23, 0x28, 0x29, 0x97, 0x99, 0xa1, 0xa2})
      sizes[id] = kVga;
    for (const int id : {0x1a, 0x1e, 0x1f, 0x20, 0x27, 0x2e, 0x30, 0x31, 0x32, 0x34, 0x35, 0x36, 0x3a, 0x42, 0x9a})
      sizes[id] = kHd;
    for (const int id : {0x3b, 0x40}) sizes[id] = kGenx;
    return sizes;
  }();
  const auto system = kSystems.find(pixels(fields["system_id"]));
  return system == kSystems.end() ? std::pair(0, 0) : system->second;
}

// Whether the data can be words of an encoding: types that it has, and times that do not decrease except by a wrap. One
// word in a hundred may be damaged.
template <class Word>
bool can_be(std::span<const std::byte> data, unsigned types, unsigned high_bits) {
  constexpr int kTypeShift = 8 * sizeof(Word) - 4;
  constexpr Word kPadding = static_cast<Word>(0x9999);
  std::size_t words = 0, bad = 0, highs = 0;
  Word high = 0;
  for (; data.size() >= sizeof(Word); data = data.subspan(sizeof(Word))) {
    Word word = 0;
    std::memcpy(&word, data.data(), sizeof word);
    if (sizeof word == 2 && word == kPadding) continue;
    ++words;
    const unsigned type = static_cast<unsigned>(word >> kTypeShift);
    bad += !(types >> type & 1);
    if (type != 8) continue;
    const Word next = word & static_cast<Word>((Word{1} << high_bits) - 1);
    bad += highs++ > 0 && next < high && std::uint64_t{high} - next < std::uint64_t{1} << (high_bits - 1);
    high = next;
  }
  return words >= 4 && highs > 0 && bad * 100 <= words;
}

}  // namespace

std::string raw_encoding(std::span<const std::byte> head) {
  RawHeader header = parse_raw_header(head);
  const auto data = head.subspan(header.bytes);
  const bool evt2 = can_be<std::uint32_t>(data, 0b1100'0101'0000'0011, 28);
  const bool evt3 = can_be<std::uint16_t>(data, 0b1100'0101'1111'1101, 12);
  if (evt2 != evt3) return evt2 ? "EVT2" : "EVT3";
  for (const std::string_view generation : generations(header.fields)) {  // OpenEB's rule
    if (evt2 && generation.starts_with('3') && !generation.starts_with("320")) return "EVT2";
    if (evt3 && generation.starts_with('4')) return "EVT3";
  }
  return "";
}

RawHeader parse_raw_header(std::span<const std::byte> head) {
  RawHeader header;
  const std::string_view text(reinterpret_cast<const char*>(head.data()), head.size());

  // Lines, until one is "% end" or does not begin with '%'.
  while (text.substr(header.bytes).starts_with('%')) {
    const std::size_t end = text.find('\n', header.bytes);
    if (end == std::string_view::npos) break;
    const std::string_view line = trimmed(text.substr(header.bytes + 1, end - header.bytes - 1));
    header.bytes = end + 1;
    if (line == "end") break;
    const std::size_t space = line.find(' ');
    const std::string_view value = space == std::string_view::npos ? "" : trimmed(line.substr(space));
    header.fields[lower(std::string(line.substr(0, space)))] = value;
  }

  // "EVT3;height=720;width=1280"
  std::string_view format = header.fields["format"];
  header.encoding = trimmed(format.substr(0, format.find(';')));
  std::ranges::transform(header.encoding, header.encoding.begin(), [](unsigned char c) { return std::toupper(c); });
  while (format.find(';') != std::string_view::npos) {
    format.remove_prefix(format.find(';') + 1);
    const std::string_view option = trimmed(format.substr(0, format.find(';')));
    if (const auto equals = option.find('='); equals != std::string_view::npos)
      header.options[lower(std::string(option.substr(0, equals)))] = option.substr(equals + 1);
  }
  if (header.encoding.empty()) {  // before Metavision 4
    const std::string& evt = header.fields["evt"];
    header.encoding = evt == "2.0" ? "EVT2" : evt == "2.1" ? "EVT21" : evt == "3.0" ? "EVT3" : evt;
  }

  // The size: in the format line, else in "geometry", else in DAT's "Width" and "Height".
  StreamInfo& info = header.info;
  info.width = pixels(header.options["width"]);
  info.height = pixels(header.options["height"]);
  if (info.width == 0 || info.height == 0) {
    const std::string& geometry = header.fields["geometry"];
    const std::size_t x = geometry.find('x');
    info.width = x == std::string::npos ? pixels(header.fields["width"]) : pixels(geometry.substr(0, x));
    info.height = x == std::string::npos ? pixels(header.fields["height"]) : pixels(geometry.substr(x + 1));
  }
  if (info.width == 0 || info.height == 0) std::tie(info.width, info.height) = size_of_camera(header.fields);
  info.camera = printable(header.fields["sensor_name"]);
  if (info.camera.empty() && header.fields["sensor_generation"] == "4.2") info.camera = "IMX636";
  return header;
}

std::string raw_header_text(const std::string& encoding, const std::string& evt, const StreamInfo& info,
                            const std::string& options) {
  std::string text = fmt::format("% evt {}\n% format {}{};height={};width={}\n% geometry {}x{}\n", evt, encoding,
                                 options, info.height, info.width, info.width, info.height);
  text += "% camera_integrator_name Prophesee\n% integrator_name Prophesee\n% plugin_integrator_name Prophesee\n";
  if (info.camera == "IMX636") text += "% sensor_generation 4.2\n";
  if (!info.camera.empty()) text += fmt::format("% sensor_name {}\n", info.camera);
  return text + "% end\n";
}

}  // namespace pecs::events
