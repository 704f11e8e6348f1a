#include <ImfChannelList.h>
#include <ImfIO.h>
#include <ImfInputFile.h>
#include <ImfOutputFile.h>
#include <ImfStringAttribute.h>
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cstring>

#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/sensor/stack.h"
#include "stack/exr_frame.h"

namespace pecs::sensor {
namespace {

namespace fs = std::filesystem;

// Rounds to some of the 23 mantissa bits, to nearest even: relative error <= 2^-(kept + 1).
float rounded(float v, int kept) {
  auto bits = std::bit_cast<std::uint32_t>(v);
  if ((bits & 0x7f800000u) == 0x7f800000u) return v;  // inf, NaN
  const int lost = 23 - kept;
  bits += (1u << (lost - 1)) - 1 + ((bits >> lost) & 1u);
  return std::bit_cast<float>(bits >> lost << lost);
}
constexpr int kLightBits = 12, kNoiseBits = 4;  // of the mantissa; few, since noise does not compress

// Collects a file in memory, so that write_file() writes it and detects every error (OpenEXR's own stream ignores those
// in its destructor).
class MemoryStream : public Imf::OStream {
 public:
  MemoryStream() : OStream("memory") {}
  void write(const char c[], int n) override {
    const auto count = static_cast<std::size_t>(n);
    if (at_ + count > bytes_.size()) bytes_.resize(at_ + count);
    std::memcpy(bytes_.data() + at_, c, count);
    at_ += count;
  }
  uint64_t tellp() override { return at_; }
  void seekp(uint64_t pos) override { at_ = pos; }
  std::span<const std::byte> bytes() const { return std::as_bytes(std::span(bytes_)); }

 private:
  std::vector<char> bytes_;
  std::size_t at_ = 0;
};

// Whether a folder without stack.json contains frames.
bool holds_frames(const fs::path& folder) {
  return std::ranges::any_of(fs::directory_iterator(folder), [](const fs::directory_entry& entry) {
    const std::string name = entry.path().filename().string();
    return name.starts_with("frame_") && name.ends_with(".exr");
  });
}

// Path of the first key in which two JSON values differ.
std::string first_difference(const Json& a, const Json& b) {
  const Json patch = Json::diff(a, b);
  std::string at = patch.empty() ? "" : patch[0].at("path").get<std::string>();
  if (!at.empty()) at.erase(0, 1);
  std::replace(at.begin(), at.end(), '/', '.');
  return at;
}

Imf::Header header_of(const StackInfo& info, const Layer& layer, std::int64_t time_ns) {
  Imf::Header header(info.file_width(), info.file_height());
  header.compression() = Imf::ZIP_COMPRESSION;
  if (layer.name == kLight) {
    header.insert("spectralLayoutVersion", Imf::StringAttribute("1.0"));
    header.insert("emissiveUnits", Imf::StringAttribute(layer.unit));
  } else {
    header.insert("pecsUnit", Imf::StringAttribute(layer.unit));
  }
  header.insert(kTimeAttribute, Imf::StringAttribute(std::to_string(time_ns)));
  for (const std::string& channel : layer.channels) header.channels().insert(channel, Imf::Channel(Imf::FLOAT));
  return header;
}

}  // namespace

StackWriter::StackWriter(fs::path folder, const Json& stack_json)
    : folder_(std::move(folder)), info_(parse_stack_info(stack_json, (folder_ / "stack.json").string())) {
  const fs::path json_path = folder_ / "stack.json";
  std::error_code ec;
  fs::create_directories(folder_, ec);
  if (ec) throw bad_output(folder_.string(), ec.message());
  if (fs::exists(json_path)) {
    const Json old = parse_json_file(json_path, std::size_t{64} << 20);
    if (old != stack_json)
      throw bad_output(json_path.string(),
                       fmt::format("exists and differs in '{}'", first_difference(old, stack_json)));
    return;
  }
  if (holds_frames(folder_)) throw bad_output(folder_.string(), "holds frames but no stack.json");
  write_file(json_path, stack_json.dump(1) + "\n");
}

bool StackWriter::has_frame(std::int64_t index, std::string_view name) const {
  const Layer layer = written(layer_of(info_, name, folder_));
  return index >= 0 && index < planned_frames(info_, layer) &&
         is_whole(folder_ / frame_name(layer, index), layer, info_.times_ns[static_cast<std::size_t>(index)]);
}

void StackWriter::write_frame(std::int64_t index, std::span<const float> values, std::string_view name) const {
  const Layer layer = written(layer_of(info_, name, folder_));
  const std::int64_t count = planned_frames(info_, layer);
  if (index < 0 || index >= count)
    throw bad_input(folder_.string(), "frame", std::to_string(index), fmt::format("0 to {}", count - 1));
  write(folder_ / frame_name(layer, index), layer, info_.times_ns[static_cast<std::size_t>(index)], values);
}

bool StackWriter::has_between(std::int64_t interval, std::int64_t number, std::int64_t time_ns) const {
  return is_whole(folder_ / between_name(interval, number), written(info_.layers[0]), time_ns);
}

void StackWriter::write_between(std::int64_t interval, std::int64_t number, std::int64_t time_ns,
                                std::span<const float> values) const {
  const auto [begin_ns, end_ns] = interval_ns(info_, interval, folder_);
  if (!info_.has_between) throw bad_input(folder_.string(), "between", "a picture", "\"between\": true in stack.json");
  if (time_ns <= begin_ns || time_ns >= end_ns)
    throw bad_input(folder_.string(), "between", fmt::format("{} ns", time_ns),
                    fmt::format("more than {} and less than {}", begin_ns, end_ns));
  write(folder_ / between_name(interval, number), written(info_.layers[0]), time_ns, values);
}

bool StackWriter::is_whole(const fs::path& path, const Layer& layer, std::int64_t time_ns) const {
  if (!fs::exists(path)) return false;
  try {
    return reading(path, [&] {
      Imf::InputFile file(path.string().c_str(), 0);
      check_declared_size(file.header(), path);
      const auto channels = check_header(file.header(), path, info_, layer);
      check_time(file.header(), path, time_ns, true);
      if (!file.isComplete()) return false;
      const Imath::Box2i box = file.header().dataWindow();
      std::vector<float> row(static_cast<std::size_t>(info_.file_width()) * channels.size());
      file.setFrameBuffer(frame_buffer(channels, row.data(), info_.file_width(), 1, box.min.x, box.max.y));
      file.readPixels(box.max.y);
      return true;
    });
  } catch (const Error&) {
    return false;
  }
}

Layer StackWriter::written(const Layer& layer) const {
  if (layer.name == kNoise && info_.has_noise)
    throw bad_input(folder_.string(), "layer", kNoise, "the light, whose last channel it is");
  Layer file = layer;
  if (layer.name == kLight && info_.has_noise) file.channels.emplace_back(kNoise);
  return file;
}

void StackWriter::write(const fs::path& path, const Layer& layer, std::int64_t time_ns,
                        std::span<const float> values) const {
  if (values.size() != frame_values(info_, layer))
    throw bad_input(folder_.string(), "frame", fmt::format("{} values", values.size()),
                    fmt::format("{} x {} x {}", layer.channels.size(), info_.file_height(), info_.file_width()));
  limit_exr();
  std::vector<float> copy(values.begin(), values.end());
  const std::size_t plane = values.size() / layer.channels.size();
  for (std::size_t c = 0; layer.name == kLight && c < layer.channels.size(); ++c)
    for (float& v : std::span(copy).subspan(c * plane, plane))
      v = rounded(v, layer.channels[c] == kNoise ? kNoiseBits : kLightBits);

  MemoryStream stream;
  try {
    Imf::OutputFile file(stream, header_of(info_, layer, time_ns), 0);
    file.setFrameBuffer(frame_buffer(layer.channels, copy.data(), info_.file_width(), info_.file_height(), 0, 0));
    file.writePixels(info_.file_height());
  } catch (const Iex::BaseExc& e) {
    throw bad_output(path.string(), one_line(e.what()));
  }
  write_file(path, stream.bytes());
}

}  // namespace pecs::sensor
