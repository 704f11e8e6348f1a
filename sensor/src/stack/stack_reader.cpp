#include <ImfChannelList.h>
#include <ImfChromaticitiesAttribute.h>
#include <ImfInputFile.h>
#include <ImfMultiPartInputFile.h>
#include <ImfStringAttribute.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "pecs/error.h"
#include "pecs/platform.h"
#include "pecs/sensor/stack.h"
#include "pecs/text.h"
#include "stack/exr_block.h"
#include "stack/exr_frame.h"
#include "stack/light_kernel.h"

namespace pecs::sensor {
namespace {

namespace fs = std::filesystem;

// Rows per decoding step: a compressed block of the file, so that each is decompressed once.
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

std::int64_t frame_index(const Layer& layer, const std::string& name) {
  if (!name.starts_with(layer.prefix)) return -1;
  const std::size_t digits = std::min(name.find('.'), name.size());
  const auto index = number_from<std::int64_t>(std::string_view(name).substr(0, digits).substr(layer.prefix.size()));
  return index && name == frame_name(layer, *index) ? *index : -1;
}

void check_motion(const Layer& layer, const std::string& file) {
  std::vector<std::string> channels;
  for (const char* way : {"", "back_"})
    for (const char* name : {"x_q1", "y_q1", "x_mid", "y_mid", "x_q3", "y_q3", "x_end", "y_end", "z", "z_end"})
      channels.push_back(fmt::format("{}{}", way, name));
  if (!layer.per_interval) throw bad_input(file, "layers: motion: at", "instant", "interval");
  if (layer.channels != channels)
    throw bad_input(file, "layers: motion: channels", fmt::format("{}", fmt::join(layer.channels, " ")),
                    fmt::format("{}", fmt::join(channels, " ")));
}

std::vector<std::int64_t> frames_in(const fs::path& folder, const Layer& layer) {
  std::vector<std::int64_t> indices;
  for (const auto& entry : fs::directory_iterator(folder))
    if (const auto i = frame_index(layer, entry.path().filename().string()); i >= 0) indices.push_back(i);
  std::sort(indices.begin(), indices.end());
  return indices;
}

// Sorted numbers of the pictures within intervals.
std::map<std::int64_t, std::vector<std::int64_t>> betweens_in(const fs::path& folder) {
  std::map<std::int64_t, std::vector<std::int64_t>> found;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    long long interval = 0, number = 0;
    if (std::sscanf(name.c_str(), "between_%lld_%lld.exr", &interval, &number) == 2 &&
        name == between_name(interval, number))
      found[interval].push_back(number);
  }
  for (auto& [interval, numbers] : found) std::ranges::sort(numbers);
  return found;
}

// An EXR sequence of another program.
struct ForeignStack {
  StackInfo info;                       // without times
  std::string layout;                   // its name
  Imath::Box2i window;                  // of all its files
  std::optional<std::int64_t> time_ns;  // in the header of the first file: a stack of PECS without its stack.json
};

// Weights of bands without any: a band extends halfway to its neighbours, an outer one equally far to both sides, as in
// the layout of Fichet et al. (pbrt's values are means over such buckets).
void bucket_weights(std::vector<Band>& bands) {
  const std::size_t n = bands.size();
  if (n < 2) return;
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t left = i ? i - 1 : 0, right = std::min(i + 1, n - 1);
    bands[i].weight_nm = (bands[right].lambda_nm - bands[left].lambda_nm) / static_cast<double>(right - left);
  }
}

Quantity quantity_of(const Imf::Header& header, const fs::path& path) {
  const auto* units = header.findTypedAttribute<Imf::StringAttribute>("emissiveUnits");
  constexpr const char* kPerNm = "W.m^-2.sr^-1";  // of the layout's paper: per nm as well
  if (!units || units->value() == unit_of(Quantity::radiance) || units->value() == kPerNm) return Quantity::radiance;
  if (units->value() == unit_of(Quantity::irradiance)) return Quantity::irradiance;
  throw bad_input(path.string(), "emissiveUnits", shortened(units->value(), 40),
                  fmt::format("{}, {} or {}", unit_of(Quantity::radiance), kPerNm, unit_of(Quantity::irradiance)));
}

// R, G and B are those of Rec. 709, which the bands stand for.
void check_primaries(const Imf::Header& header, const fs::path& path) {
  const auto* given = header.findTypedAttribute<Imf::ChromaticitiesAttribute>("chromaticities");
  const Imf::Chromaticities rec709, file = given ? given->value() : rec709;
  for (const auto at : {&Imf::Chromaticities::red, &Imf::Chromaticities::green, &Imf::Chromaticities::blue})
    if (const Imath::V2f got = file.*at, wanted = rec709.*at; !got.equalWithAbsError(wanted, 0.01f))
      throw bad_input(path.string(), "chromaticities", fmt::format("a primary at ({:.4g}, {:.4g})", got.x, got.y),
                      fmt::format("({:.4g}, {:.4g}) of Rec. 709 (convert the frames)", wanted.x, wanted.y));
}

// Throws bad_input for a file of the light in another unit than the stack's.
void check_unit(const Imf::Header& header, const fs::path& path, const StackInfo& info) {
  if (info.quantity == Quantity::relative) return check_primaries(header, path);
  if (header.findTypedAttribute<Imf::StringAttribute>("emissiveUnits") && quantity_of(header, path) != info.quantity)
    throw bad_input(path.string(), "emissiveUnits", unit_of(quantity_of(header, path)),
                    fmt::format("{}, as in the stack", unit_of(info.quantity)));
}

// Throws bad_input if a further part has all channels of the first one's light: a second eye, or another render.
void check_parts(const fs::path& path, const Layer& light) {
  const Imf::MultiPartInputFile file(path.string().c_str(), 0);
  for (int part = 1; part < file.parts(); ++part)
    if (std::ranges::all_of(light.channels, [&](const std::string& channel) {
          return file.header(part).channels().findChannel(channel) != nullptr;
        }))
      throw bad_input(path.string(), "parts", fmt::format("light in part 0 and in part {}", part), "one part of light");
}

// Found by the names of the channels in a file.
ForeignStack foreign_stack(const fs::path& path) {
  return reading(path, [&] {
    const Imf::InputFile file(path.string().c_str(), 0);
    check_declared_size(file.header(), path);
    const Imf::Header& header = file.header();
    ForeignStack f;
    StackInfo& info = f.info;
    f.window = frame_window(header, true);
    if (header.findTypedAttribute<Imf::StringAttribute>(kTimeAttribute)) f.time_ns = time_of(header, path);
    info.width = width_of(f.window);
    info.height = height_of(f.window);
    info.quantity = quantity_of(header, path);
    std::vector<std::pair<double, std::string>> found;
    std::vector<std::string> numbered;
    std::string reflectance;
    for (auto c = header.channels().begin(); c != header.channels().end(); ++c) {
      const std::string name = c.name();
      if (const auto lambda = channel_lambda_nm(name)) found.emplace_back(*lambda, name);
      if (name.starts_with("Radiance.C")) numbered.push_back(name);  // sorted: C01, C02, …
      if (name.starts_with("T.") && channel_lambda_nm("S0" + name.substr(1))) reflectance = name;
    }
    if (found.empty() && !reflectance.empty())
      throw bad_input(path.string(), "channels", "a reflectance, " + reflectance, "light, S0.<wavelength>nm");
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
    Layer light{kLight, "", {}, unit_of(info.quantity)};
    for (const auto& [lambda_nm, name] : found) {
      info.bands.push_back({lambda_nm, 1});
      light.channels.push_back(name);
    }
    if (f.layout != "RGB EXR") bucket_weights(info.bands);
    check_unit(header, path, info);
    check_parts(path, light);
    info.layers = {std::move(light)};
    return f;
  });
}

// Rows of a frame's window in a file whose data window is another; black outside it.
void read_window(Imf::InputFile& file, const Imath::Box2i& window, std::span<const std::string> channels,
                 const RowSink& sink, int begin, int end) {
  const Imath::Box2i data = file.header().dataWindow();
  const int width = width_of(window), data_width = width_of(data), step = rows_per_block(file.header());
  const int left = std::max(window.min.x, data.min.x), right = std::min(window.max.x, data.max.x);
  const auto size = [&](int columns) { return static_cast<std::size_t>(columns * step) * channels.size(); };
  std::vector<float> values(size(width)), read(size(data_width));
  for (int y = begin; y < end; y += step) {
    const int rows = std::min(step, end - y), first = window.min.y + y;
    const int top = std::max(first, data.min.y), bottom = std::min(first + rows - 1, data.max.y);
    std::ranges::fill(values, 0.0f);
    if (left <= right && top <= bottom) {
      file.setFrameBuffer(frame_buffer(channels, read.data(), data_width, step, data.min.x, top));
      file.readPixels(top, bottom);
      for (std::size_t c = 0; c < channels.size(); ++c)
        for (int row = top; row <= bottom; ++row) {
          const auto plane = static_cast<std::ptrdiff_t>(c);
          std::copy_n(read.begin() + (plane * step + row - top) * data_width + left - data.min.x, right - left + 1,
                      values.begin() + (plane * rows + row - first) * width + left - window.min.x);
        }
    }
    sink(y, rows, std::span(values).first(static_cast<std::size_t>(width * rows) * channels.size()));
  }
}

}  // namespace

StackReader::StackReader(fs::path folder, const FrameTimes& times) : folder_(std::move(folder)) {
  if (!fs::exists(folder_)) throw not_found(folder_.string(), "no such folder");
  if (!fs::is_directory(folder_)) throw not_found(folder_.string(), "not a folder");
  const fs::path json_path = folder_ / "stack.json";
  has_json_ = fs::exists(json_path);
  if (!has_json_) {
    static const std::string kExr[] = {".exr"};
    files_ = frame_files(folder_, kExr, times);
    if (files_.empty()) throw not_found(folder_.string(), "holds no EXR files");
    frames_ = static_cast<std::int64_t>(files_.size());
    ForeignStack foreign = foreign_stack(files_[0]);
    info_ = std::move(foreign.info);
    layout_ = std::move(foreign.layout);
    corner_ = {foreign.window.min.x, foreign.window.min.y};
    info_.times_ns = times.of(frames_, folder_.string());
    if (foreign.time_ns) header_shift_ns_ = *foreign.time_ns - info_.times_ns[0];
    return;
  }
  const char* kWithoutTimes = "frames without times of their own";
  if (times.fps) throw bad_usage("--fps", folder_.string(), kWithoutTimes);
  if (times.unit) throw bad_usage("--time-unit", folder_.string(), std::string("--times, and ") + kWithoutTimes);
  if (times.file_us) throw bad_usage("--times", folder_.string(), kWithoutTimes);
  header_shift_ns_ = 0;
  info_ = parse_stack_info(parse_json_file(json_path, std::size_t{64} << 20), json_path.string());
  if (info_.has_between) between_ = betweens_in(folder_);
  const Layer& light = info_.layers[0];
  if (!info_.has_light) {
    frames_ = std::ssize(info_.times_ns);
    return;
  }
  const std::vector<std::int64_t> present = frames_in(folder_, light);
  if (present.empty()) throw not_found(folder_.string(), "holds no frame_000000.exr");
  for (std::size_t i = 0; i < present.size(); ++i)
    if (present[i] != static_cast<std::int64_t>(i))
      throw bad_input(folder_.string(), "frames",
                      fmt::format("{} missing before {}", frame_name(light, static_cast<std::int64_t>(i)),
                                  frame_name(light, present[i])),
                      "no gap");
  frames_ = static_cast<std::int64_t>(present.size());
  if (frames_ > static_cast<std::int64_t>(info_.times_ns.size()))
    throw bad_input(folder_.string(), "frames", std::to_string(frames_),
                    fmt::format("the {} of times_ns", info_.times_ns.size()));
}

std::vector<std::int64_t> StackReader::between_ns(std::int64_t interval) const {
  const auto found = between_.find(interval);
  if (found == between_.end()) return {};
  const auto [begin_ns, end_ns] = interval_ns(info_, interval, folder_);
  std::vector<std::int64_t> times;
  for (std::size_t k = 0; k < found->second.size(); ++k) {
    const fs::path path = between_path(interval, k);
    const std::int64_t last = times.empty() ? begin_ns : times.back();
    const std::int64_t time =
        reading(path, [&] { return time_of(Imf::InputFile(path.string().c_str(), 0).header(), path); });
    if (time <= last || time >= end_ns)
      throw bad_input(path.string(), kTimeAttribute, std::to_string(time),
                      fmt::format("more than {} and less than {}", last, end_ns));
    times.push_back(time);
  }
  return times;
}

fs::path StackReader::between_path(std::int64_t interval, std::size_t which) const {
  return folder_ / between_name(interval, between_.at(interval).at(which));
}

void StackReader::read_between(std::int64_t interval, std::size_t which, const RowSink& sink) const {
  read_file(between_path(interval, which), info_.layers[0], {}, sink, 0, info_.file_height());
}

void StackReader::read_between_noise(std::int64_t interval, std::size_t which, const RowSink& sink) const {
  read_file(between_path(interval, which), layer_of(info_, kNoise, folder_), {}, sink, 0, info_.file_height());
}

void StackReader::will_read(std::int64_t index) const { platform::will_read(frame_path(index)); }

fs::path StackReader::frame_path(std::int64_t index) const {
  return has_json_ ? folder_ / frame_name(info_.layers[0], index) : files_.at(static_cast<std::size_t>(index));
}

bool StackReader::has_motion() const {
  const auto layer = std::ranges::find(info_.layers, kMotion, &Layer::name);
  if (layer == info_.layers.end()) return false;
  check_motion(*layer, (folder_ / "stack.json").string());
  return true;
}

void StackReader::read_motion(std::int64_t interval, const RowSink& sink) const {
  read_rows(interval, layer_of(info_, kMotion, folder_), sink, 0, 0);
}

void StackReader::read_rows(std::int64_t index, const RowSink& sink, int begin, int end) const {
  const int side = info_.subpixels;
  if (side == 1) return read_rows(index, info_.layers[0], sink, begin, end);
  const auto step = static_cast<std::size_t>(side), width = static_cast<std::size_t>(info_.width);
  std::vector<float> means;
  const auto average = [&](int y, int rows, std::span<const float> values) {
    means.resize(values.size() / (step * step));
    for (std::size_t i = 0; i < means.size(); i += width)
      average_squares(values.data() + i * step * step, width * step, step, {means.data() + i, width});
    sink(y / side, rows / side, means);
  };
  read_rows(index, info_.layers[0], average, begin * side, end * side);
}

void StackReader::read_fine_rows(std::int64_t index, const RowSink& sink) const {
  read_rows(index, info_.layers[0], sink, 0, 0);
}

void StackReader::read_noise(std::int64_t index, const RowSink& sink) const {
  read_rows(index, layer_of(info_, kNoise, folder_), sink, 0, 0);
}

void StackReader::read_rows(std::int64_t index, const Layer& layer, const RowSink& sink, int begin, int end) const {
  if (end == 0) end = info_.file_height();
  const std::int64_t count = has_json_ ? planned_frames(info_, layer) : frames_;
  if (index < 0 || index >= count)
    throw bad_input(folder_.string(), "frame", std::to_string(index), fmt::format("0 to {}", count - 1));
  const bool is_light = layer.name == kLight;
  if (is_light && !info_.has_light) throw bad_input(folder_.string(), "light", "layers alone", "a stack with light");
  std::optional<std::int64_t> time_ns;
  if (header_shift_ns_) time_ns = info_.times_ns[static_cast<std::size_t>(index)] + *header_shift_ns_;
  read_file(is_light ? frame_path(index) : folder_ / frame_name(layer, index), layer, time_ns, sink, begin, end);
}

void StackReader::read_file(const fs::path& path, const Layer& layer, std::optional<std::int64_t> time_ns,
                            const RowSink& sink, int begin, int end) const {
  if (!fs::exists(path)) throw not_found(path.string(), "no such file");
  reading(path, [&] {
    Imf::InputFile file(path.string().c_str(), 0);
    check_declared_size(file.header(), path);
    const auto channels = check_header(file.header(), path, info_, layer, !has_json_);
    constexpr std::int64_t kRounding_ns = 1000;  // of --fps and --times
    if (time_ns) check_time(file.header(), path, *time_ns, layer.name != kLight, has_json_ ? 0 : kRounding_ns);
    if (layer.name == kLight) check_unit(file.header(), path, info_);
    const Imath::Box2i box = file.header().dataWindow();
    if (!has_json_) {
      const Imath::Box2i& window = frame_window(file.header(), true);
      if (window.min.x != corner_.first || window.min.y != corner_.second)
        throw bad_input(path.string(), "window", fmt::format("({}, {})", window.min.x, window.min.y),
                        fmt::format("({}, {}), as in the first file", corner_.first, corner_.second));
      if (window != box) return read_window(file, window, channels, sink, begin, end);
    }
    const int in_block = rows_per_block(file.header());
    const bool whole_pixels = in_block % info_.subpixels == 0;
    const int step = whole_pixels ? in_block : info_.subpixels;
    const auto zip = whole_pixels ? ZipBlocks::of(file, channels) : nullptr;
    const auto width = static_cast<std::size_t>(info_.file_width());
    std::vector<float> values(width * static_cast<std::size_t>(step) * channels.size());
    for (int y = begin; y < end;) {
      const int rows = std::min(step - y % step, end - y);  // to the end of the block
      const auto block = std::span(values).first(width * static_cast<std::size_t>(rows) * channels.size());
      if (zip) {
        zip->read(y, rows, block);
      } else {
        file.setFrameBuffer(frame_buffer(channels, values.data(), info_.file_width(), rows, box.min.x, box.min.y + y));
        file.readPixels(box.min.y + y, box.min.y + y + rows - 1);
      }
      sink(y, rows, block);
      y += rows;
    }
  });
}

SourceReport StackReader::report() const {
  SourceReport out;
  if (!info_.has_light) return out;
  const fs::path path = frame_path(0);
  bool is_half = false, is_lossy = false;
  reading(path, [&] {
    const Imf::InputFile file(path.string().c_str(), 0);
    const Imf::Header& header = file.header();
    for (const std::string& name : check_header(header, path, info_, info_.layers[0], !has_json_))
      is_half |= header.channels()[name].type == Imf::HALF;
    const Imf::Compression how = header.compression();
    is_lossy = how == Imf::DWAA_COMPRESSION || how == Imf::DWAB_COMPRESSION ||
               (is_half && (how == Imf::B44_COMPRESSION || how == Imf::B44A_COMPRESSION));
  });
  if (is_lossy)
    out.warnings.push_back(fmt::format(
        "{}: compression with loss, which causes events where blocks change; write ZIP or PIZ", path.string()));
  if (!is_half) return out;
  constexpr float kDark = 3e-7f;  // a fifth of it is the step of a half below 2^-14
  const std::vector<float> light = read_frame(0);
  const auto dark = std::ranges::count_if(light, [](float v) { return v > 0 && v < kDark; });
  const double share = static_cast<double>(dark) / static_cast<double>(light.size());
  if (share > 0.01)
    out.warnings.push_back(
        fmt::format("{}: {:.0f} % of the values are so small that a step of a half changes the light by 20 % or more, "
                    "which causes events; write float, or larger values with --gain",
                    path.string(), 100 * share));
  return out;
}

std::vector<float> StackReader::read_frame(std::int64_t index, std::string_view name) const {
  const Layer& layer = layer_of(info_, name, folder_);
  return whole_frame(layer.channels.size(), info_.file_width(), info_.file_height(),
                     [&](const RowSink& sink) { read_rows(index, layer, sink, 0, 0); });
}

std::vector<float> StackReader::read_between(std::int64_t interval, std::size_t which) const {
  return whole_frame(info_.layers[0].channels.size(), info_.file_width(), info_.file_height(),
                     [&](const RowSink& sink) { read_between(interval, which, sink); });
}

}  // namespace pecs::sensor
