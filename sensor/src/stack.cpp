#include "pecs/sensor/stack.h"

#include <Iex.h>
#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfInputFile.h>
#include <ImfOutputFile.h>
#include <ImfStringAttribute.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstring>
#include <mutex>

#include "exr_block.h"
#include "exr_size.h"
#include "pecs/error.h"
#include "pecs/files.h"

namespace pecs::sensor {
namespace {

namespace fs = std::filesystem;

constexpr const char* kTimeAttribute = "pecsTimeNs";
constexpr double kSameLambda_nm = 0.005;  // channel names carry three decimals
constexpr std::int64_t kMaxFrames = 1'000'000;

std::string frame_name(std::int64_t index) { return fmt::format("frame_{:06}.exr", index); }

// "S0.486,25nm": decimal comma, no trailing zeros.
std::string channel_name(double lambda_nm) {
  std::string number = fmt::format("{:.3f}", lambda_nm);
  number.erase(number.find_last_not_of('0') + 1);
  if (number.back() == '.') number.pop_back();
  std::replace(number.begin(), number.end(), '.', ',');
  return "S0." + number + "nm";
}

// The wavelength in a channel name of the layout's emissive kind, S0.550nm, or of Mitsuba, whose names hold no point:
// S0_550nm, band_550nm. Nothing for other channels.
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

// 12 of the 23 mantissa bits, to nearest even: relative error <= 2^-13.
float rounded(float v) {
  auto bits = std::bit_cast<std::uint32_t>(v);
  if ((bits & 0x7f800000u) == 0x7f800000u) return v;  // inf, NaN
  bits += 0x3ffu + ((bits >> 11) & 1u);
  return std::bit_cast<float>(bits & ~0x7ffu);
}

// OpenEXR's global limits, set once before anything is read or written.
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

// Runs f; what OpenEXR throws becomes our error with the file's name.
template <class F>
auto reading(const fs::path& path, F&& f) {
  limit_exr();
  try {
    return f();
  } catch (const Error&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const Iex::ErrnoExc& e) {
    throw not_found(path.string(), one_line(e.what()));
  } catch (const std::exception& e) {
    throw bad_input(path.string(), "OpenEXR", one_line(e.what()), "a whole OpenEXR file");
  }
}

// Collects a file in memory, so that AtomicFile writes it and sees every error (OpenEXR's own stream hides those of
// its destructor).
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

struct Channels {
  std::vector<std::string> names;  // one per band, in the stack's order
};

int side(const Imf::Header& header, bool x) {
  const Imath::Box2i box = header.dataWindow();
  return x ? box.max.x - box.min.x + 1 : box.max.y - box.min.y + 1;
}

// What the header of a frame must say to belong to the stack.
Channels check_header(const Imf::Header& header, const fs::path& path, const StackInfo& info, std::int64_t time_ns,
                      bool need_time) {
  const int width = side(header, true), height = side(header, false);
  if (width != info.width || height != info.height)
    throw bad_input(path.string(), "dataWindow", fmt::format("{}x{}", width, height),
                    fmt::format("{}x{}", info.width, info.height));
  std::vector<std::pair<double, std::string>> found;
  for (auto c = header.channels().begin(); c != header.channels().end(); ++c)
    if (const auto lambda = channel_lambda_nm(c.name())) {
      if (c.channel().xSampling != 1 || c.channel().ySampling != 1)
        throw bad_input(path.string(), c.name(), "a subsampled channel", "one value per pixel");
      found.emplace_back(*lambda, c.name());
    }
  Channels channels;
  for (const Band& band : info.bands) {
    const auto hit = std::find_if(found.begin(), found.end(),
                                  [&](const auto& f) { return std::abs(f.first - band.lambda_nm) < kSameLambda_nm; });
    if (hit == found.end())
      throw bad_input(path.string(), "channels",
                      found.empty() ? "no S0.<wavelength>nm channel" : fmt::format("{} others", found.size()),
                      channel_name(band.lambda_nm));
    channels.names.push_back(hit->second);
  }
  if (const auto* time = header.findTypedAttribute<Imf::StringAttribute>(kTimeAttribute)) {
    if (time->value() != std::to_string(time_ns))
      throw bad_input(path.string(), kTimeAttribute, time->value().substr(0, 40), std::to_string(time_ns));
  } else if (need_time) {
    throw bad_input(path.string(), kTimeAttribute, "nothing", std::to_string(time_ns));
  }
  return channels;
}

Channels check_foreign(const Imf::Header& header, const fs::path& path, const StackInfo& info,
                       const std::vector<std::string>& names) {
  const int width = side(header, true), height = side(header, false);
  if (width != info.width || height != info.height)
    throw bad_input(path.string(), "dataWindow", fmt::format("{}x{}", width, height),
                    fmt::format("{}x{}", info.width, info.height));
  for (const std::string& name : names) {
    const Imf::Channel* channel = header.channels().findChannel(name);
    if (!channel) throw bad_input(path.string(), "channels", "others than the first frame", name);
    if (channel->xSampling != 1 || channel->ySampling != 1)
      throw bad_input(path.string(), name, "a subsampled channel", "one value per pixel");
  }
  return {names};
}

Imf::FrameBuffer frame_buffer(const Channels& channels, float* values, int width, int rows, int min_x, int first_y) {
  Imf::FrameBuffer buffer;
  const std::size_t plane = static_cast<std::size_t>(width) * static_cast<std::size_t>(rows);
  for (std::size_t b = 0; b < channels.names.size(); ++b) {
    // OpenEXR wants the address of pixel (0, 0), which may lie outside the array.
    float* origin = values + b * plane;
    char* base = reinterpret_cast<char*>(origin) -
                 (static_cast<std::ptrdiff_t>(min_x) + static_cast<std::ptrdiff_t>(first_y) * width) *
                     static_cast<std::ptrdiff_t>(sizeof(float));
    buffer.insert(channels.names[b],
                  Imf::Slice(Imf::FLOAT, base, sizeof(float), sizeof(float) * static_cast<std::size_t>(width)));
  }
  return buffer;
}

// Rows per decoding step: a compressed block of the file, so that none is inflated twice.
int rows_per_block(const Imf::Header& header) {
  if (header.hasTileDescription()) return static_cast<int>(std::min(header.tileDescription().ySize, 256u));
  switch (header.compression()) {
    case Imf::ZIPS_COMPRESSION:
      return 1;
    case Imf::DWAB_COMPRESSION:
      return 256;
    case Imf::PIZ_COMPRESSION:
    case Imf::B44_COMPRESSION:
    case Imf::B44A_COMPRESSION:
    case Imf::DWAA_COMPRESSION:
      return 32;
    default:
      return 16;
  }
}

std::int64_t frame_index(const std::string& name) {
  std::int64_t index = -1;
  if (!name.starts_with("frame_") || !name.ends_with(".exr")) return -1;
  const char* end = name.data() + name.size() - 4;
  const auto [stop, ec] = std::from_chars(name.data() + 6, end, index);
  return ec == std::errc() && stop == end && name == frame_name(index) ? index : -1;
}

std::vector<std::int64_t> frames_in(const fs::path& folder) {
  std::vector<std::int64_t> indices;
  for (const auto& entry : fs::directory_iterator(folder))
    if (const auto i = frame_index(entry.path().filename().string()); i >= 0) indices.push_back(i);
  std::sort(indices.begin(), indices.end());
  return indices;
}

// Path of the first key in which two JSON values differ.
std::string first_difference(const Json& a, const Json& b) {
  const Json patch = Json::diff(a, b);
  std::string at = patch.empty() ? "" : patch[0].at("path").get<std::string>();
  if (!at.empty()) at.erase(0, 1);
  std::replace(at.begin(), at.end(), '/', '.');
  return at;
}

}  // namespace

StackInfo parse_stack_info(const Json& json, const std::string& file) {
  JsonObject o(json, file);
  o.integer("pecs_stack", 1, 1);
  StackInfo info;
  info.quantity =
      o.one_of("quantity", {"irradiance", "radiance"}) == "irradiance" ? Quantity::irradiance : Quantity::radiance;
  info.width = static_cast<int>(o.integer("width", 1, kMaxSide));
  info.height = static_cast<int>(o.integer("height", 1, kMaxSide));
  info.pixel_pitch_m = o.maybe_number("pixel_pitch_m", {1e-7, 1e-3});
  if (info.quantity == Quantity::irradiance && !info.pixel_pitch_m) o.fail("pixel_pitch_m", "nothing", "metres");
  for (JsonObject& band : o.objects("bands")) {
    const Band b{band.number("lambda_nm", {100, 20000}), band.number("weight_nm", {0, 1e6})};
    if (!info.bands.empty() && b.lambda_nm < info.bands.back().lambda_nm + 2 * kSameLambda_nm)
      band.fail("lambda_nm", fmt::format("{}", b.lambda_nm), "rising wavelengths");
    info.bands.push_back(b);
    band.done();
  }
  if (info.bands.empty() || info.bands.size() > kMaxBands)
    o.fail("bands", fmt::format("{} bands", info.bands.size()), fmt::format("1 to {}", kMaxBands));
  const Json& times = o.any("times_ns");
  if (!times.is_array() || times.empty() || times.size() > kMaxFrames)
    o.fail("times_ns", times.is_array() ? fmt::format("{} times", times.size()) : "no list",
           fmt::format("a list of 1 to {} integers", kMaxFrames));
  for (std::size_t i = 0; i < times.size(); ++i) {
    const std::string place = fmt::format("times_ns[{}]", i);
    if (!times[i].is_number_integer()) o.fail(place, times[i].dump().substr(0, 40), "an integer");
    const auto t = times[i].get<std::int64_t>();
    if (t < 0 || t > std::int64_t{1} << 60) o.fail(place, std::to_string(t), "0 to 2^60 ns");
    if (i && t <= info.times_ns.back())
      o.fail(place, std::to_string(t), fmt::format("more than {}", info.times_ns.back()));
    info.times_ns.push_back(t);
  }
  if (o.has("period_ns")) {
    info.period_ns = o.integer("period_ns", 1, std::int64_t{1} << 60);
    if (*info.period_ns <= info.times_ns.back() - info.times_ns.front())
      o.fail("period_ns", std::to_string(*info.period_ns), "more than the span of times_ns");
  }
  // Said for the reader's benefit, not needed here.
  if (o.has("lens")) o.object("lens");
  for (const char* key : {"scene", "render", "versions"}) o.object(key);
  o.done();
  return info;
}

// ---- writer -------------------------------------------------------------------------------------------------------

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
  if (!frames_in(folder_).empty()) throw bad_output(folder_.string(), "holds frames but no stack.json");
  AtomicFile file(json_path);
  file.write(stack_json.dump(1) + "\n");
  file.commit();
}

bool StackWriter::has_frame(std::int64_t index) const {
  const fs::path path = folder_ / frame_name(index);
  if (index < 0 || index >= static_cast<std::int64_t>(info_.times_ns.size()) || !fs::exists(path)) return false;
  try {
    return reading(path, [&] {
      Imf::InputFile file(path.c_str(), 0);
      const Channels channels =
          check_header(file.header(), path, info_, info_.times_ns[static_cast<std::size_t>(index)], true);
      if (!file.isComplete()) return false;
      const Imath::Box2i box = file.header().dataWindow();
      std::vector<float> row(static_cast<std::size_t>(info_.width) * info_.bands.size());
      file.setFrameBuffer(frame_buffer(channels, row.data(), info_.width, 1, box.min.x, box.max.y));
      file.readPixels(box.max.y);
      return true;
    });
  } catch (const Error&) {
    return false;
  }
}

void StackWriter::write_frame(std::int64_t index, std::span<const float> values) const {
  const auto count = static_cast<std::int64_t>(info_.times_ns.size());
  const std::size_t plane = static_cast<std::size_t>(info_.width) * static_cast<std::size_t>(info_.height);
  if (index < 0 || index >= count)
    throw bad_input(folder_.string(), "frame", std::to_string(index), fmt::format("0 to {}", count - 1));
  if (values.size() != plane * info_.bands.size())
    throw bad_input(folder_.string(), "frame", fmt::format("{} values", values.size()),
                    fmt::format("{} x {} x {}", info_.bands.size(), info_.height, info_.width));
  limit_exr();

  Imf::Header header(info_.width, info_.height);
  header.compression() = Imf::ZIP_COMPRESSION;
  header.insert("spectralLayoutVersion", Imf::StringAttribute("1.0"));
  header.insert("emissiveUnits", Imf::StringAttribute(unit_of(info_.quantity)));
  header.insert(kTimeAttribute, Imf::StringAttribute(std::to_string(info_.times_ns[static_cast<std::size_t>(index)])));
  Channels channels;
  for (const Band& band : info_.bands) {
    channels.names.push_back(channel_name(band.lambda_nm));
    header.channels().insert(channels.names.back(), Imf::Channel(Imf::FLOAT));
  }
  std::vector<float> copy(values.size());
  std::transform(values.begin(), values.end(), copy.begin(), rounded);

  const fs::path path = folder_ / frame_name(index);
  MemoryStream stream;
  try {
    Imf::OutputFile file(stream, header, 0);
    file.setFrameBuffer(frame_buffer(channels, copy.data(), info_.width, info_.height, 0, 0));
    file.writePixels(info_.height);
  } catch (const Iex::BaseExc& e) {
    throw bad_output(path.string(), one_line(e.what()));
  }
  AtomicFile file(path);
  file.write(stream.bytes());
  file.commit();
}

// ---- reader -------------------------------------------------------------------------------------------------------

namespace {

// Weights of bands that came without: a band reaches halfway to its neighbours, an outer one as far to either side, as
// in the layout of Fichet et al. (pbrt's values are means over such buckets).
void bucket_weights(std::vector<Band>& bands) {
  const std::size_t n = bands.size();
  if (n < 2) return;
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t left = i ? i - 1 : 0, right = std::min(i + 1, n - 1);
    bands[i].weight_nm = (bands[right].lambda_nm - bands[left].lambda_nm) / static_cast<double>(right - left);
  }
}

struct Foreign {
  StackInfo info;
  std::vector<std::string> channels;  // of the bands
  std::string layout;
};

// What a file of another program holds, by its channels' names.
Foreign foreign_layout(const fs::path& path) {
  return reading(path, [&] {
    const Imf::InputFile file(path.c_str(), 0);
    check_declared_size(file.header(), path);
    const Imf::Header& header = file.header();
    Foreign f;
    StackInfo& info = f.info;
    info.width = side(header, true);
    info.height = side(header, false);
    const auto* units = header.findTypedAttribute<Imf::StringAttribute>("emissiveUnits");
    info.quantity =
        units && units->value() == unit_of(Quantity::irradiance) ? Quantity::irradiance : Quantity::radiance;
    std::vector<std::pair<double, std::string>> found;
    std::vector<std::string> numbered;
    for (auto c = header.channels().begin(); c != header.channels().end(); ++c) {
      const std::string name = c.name();
      if (const auto lambda = channel_lambda_nm(name)) found.emplace_back(*lambda, name);
      if (name.starts_with("Radiance.C")) numbered.push_back(name);  // sorted: C01, C02, …
    }
    f.layout = "spectral EXR";
    if (found.empty() && numbered.size() > 1) {
      f.layout = "pbrt Radiance.C01…";
      for (std::size_t i = 0; i < numbered.size(); ++i)
        found.emplace_back(400 + 300.0 * static_cast<double>(i) / static_cast<double>(numbered.size() - 1),
                           numbered[i]);
    }
    const auto has = [&](const char* name) { return header.channels().findChannel(name) != nullptr; };
    if (found.empty() && has("R") && has("G") && has("B")) {
      f.layout = "RGB EXR";
      info.quantity = Quantity::relative;
      found = {{465, "B"}, {550, "G"}, {610, "R"}};
    }
    if (found.empty() || found.size() > kMaxBands)
      throw bad_input(path.string(), "channels", fmt::format("{} named S0.<wavelength>nm", found.size()),
                      fmt::format("1 to {}, or Radiance.C01…, or R, G, B", kMaxBands));
    std::ranges::sort(found);
    for (const auto& [lambda_nm, name] : found) {
      info.bands.push_back({lambda_nm, 1});
      f.channels.push_back(name);
    }
    if (f.layout != "RGB EXR") bucket_weights(info.bands);
    return f;
  });
}

}  // namespace

StackReader::StackReader(fs::path folder, const FrameTimes& times) : folder_(std::move(folder)) {
  if (!fs::exists(folder_)) throw not_found(folder_.string(), "no such folder");
  if (!fs::is_directory(folder_)) throw not_found(folder_.string(), "not a folder");
  const fs::path json_path = folder_ / "stack.json";
  has_json_ = fs::exists(json_path);
  if (!has_json_) {
    static const std::string kExr[] = {".exr"};
    files_ = files_in_order(folder_, kExr);
    if (files_.empty()) throw not_found(folder_.string(), "holds no EXR files");
    frames_ = static_cast<std::int64_t>(files_.size());
    Foreign foreign = foreign_layout(files_[0]);
    info_ = std::move(foreign.info);
    channels_ = std::move(foreign.channels);
    layout_ = std::move(foreign.layout);
    info_.times_ns = times.of(frames_, folder_.string());
    return;
  }
  const std::vector<std::int64_t> present = frames_in(folder_);
  if (present.empty()) throw not_found(folder_.string(), "holds no frame_000000.exr");
  for (std::size_t i = 0; i < present.size(); ++i)
    if (present[i] != static_cast<std::int64_t>(i))
      throw bad_input(
          folder_.string(), "frames",
          fmt::format("{} missing before {}", frame_name(static_cast<std::int64_t>(i)), frame_name(present[i])),
          "no gap");
  frames_ = static_cast<std::int64_t>(present.size());
  info_ = parse_stack_info(parse_json_file(json_path, std::size_t{64} << 20), json_path.string());
  if (frames_ > static_cast<std::int64_t>(info_.times_ns.size()))
    throw bad_input(folder_.string(), "frames", std::to_string(frames_),
                    fmt::format("the {} of times_ns", info_.times_ns.size()));
}

void StackReader::will_read(std::int64_t index) const {
  const int fd = ::open(frame_path(index).c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return;
  ::posix_fadvise(fd, 0, 0, POSIX_FADV_WILLNEED);
  ::close(fd);
}

fs::path StackReader::frame_path(std::int64_t index) const {
  return has_json_ ? folder_ / frame_name(index) : files_.at(static_cast<std::size_t>(index));
}

void StackReader::read_rows(std::int64_t index, const RowSink& sink, int begin, int end) const {
  if (end == 0) end = info_.height;
  const fs::path path = frame_path(index);
  if (!fs::exists(path)) throw not_found(path.string(), "no such file");
  reading(path, [&] {
    Imf::InputFile file(path.c_str(), 0);
    check_declared_size(file.header(), path);
    const std::int64_t time_ns = has_json_ ? info_.times_ns.at(static_cast<std::size_t>(index)) : 0;
    Channels channels;
    if (has_json_) {
      channels = check_header(file.header(), path, info_, time_ns, false);
    } else {
      channels = check_foreign(file.header(), path, info_, channels_);
    }
    const Imath::Box2i box = file.header().dataWindow();
    const int step = rows_per_block(file.header());
    const auto zip = ZipBlocks::of(file, channels.names);
    std::vector<float> values(static_cast<std::size_t>(info_.width) * static_cast<std::size_t>(step) *
                              info_.bands.size());
    for (int y = begin; y < end;) {
      const int rows = std::min(step - y % step, end - y);  // to the end of the block
      const auto block = std::span(values).first(static_cast<std::size_t>(info_.width) *
                                                 static_cast<std::size_t>(rows) * info_.bands.size());
      if (zip) {
        zip->read(y, rows, block);
      } else {
        file.setFrameBuffer(frame_buffer(channels, values.data(), info_.width, rows, box.min.x, box.min.y + y));
        file.readPixels(box.min.y + y, box.min.y + y + rows - 1);
      }
      sink(y, rows, block);
      y += rows;
    }
  });
}

std::vector<float> StackReader::read_frame(std::int64_t index) const {
  const auto width = static_cast<std::size_t>(info_.width), height = static_cast<std::size_t>(info_.height);
  std::vector<float> frame(width * height * info_.bands.size());
  read_rows(index, [&](int y, int rows, std::span<const float> values) {
    const std::size_t block = width * static_cast<std::size_t>(rows);
    for (std::size_t b = 0; b < info_.bands.size(); ++b)
      std::copy_n(values.begin() + static_cast<std::ptrdiff_t>(b * block), block,
                  frame.begin() + static_cast<std::ptrdiff_t>((b * height + static_cast<std::size_t>(y)) * width));
  });
  return frame;
}

}  // namespace pecs::sensor
