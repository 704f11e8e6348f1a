// Reads and checks stack.json.
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cctype>

#include "pecs/error.h"
#include "pecs/sensor/stack.h"
#include "stack/exr_frame.h"

namespace pecs::sensor {
namespace {

constexpr std::int64_t kMaxFrames = 1'000'000;
constexpr std::size_t kMaxLayers = 32;
constexpr int kMaxSubpixels = 4;
constexpr std::string_view kNumber = "%06d.exr";

// Names of layers, channels and files have only letters, digits, '_' and '-', so that they cannot contain a path.
bool is_word(std::string_view text) {
  return !text.empty() && text.size() <= 64 && std::ranges::all_of(text, [](unsigned char c) {
    return c < 128 && (std::isalnum(c) != 0 || c == '_' || c == '-');
  });
}

void read_times(JsonObject& o, StackInfo& info) {
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
}

Layer light(const StackInfo& info) {
  Layer layer{kLight, "frame_", {}, unit_of(info.quantity)};
  for (const Band& band : info.bands) layer.channels.push_back(channel_name(band.lambda_nm));
  return layer;
}

// The light, its noise, then the layers listed in stack.json.
std::vector<Layer> layers(JsonObject& o, const StackInfo& info) {
  std::vector<Layer> all{light(info)};
  if (info.has_noise) all.push_back({kNoise, all[0].prefix, {kNoise}, "1"});
  if (!o.has("layers")) return all;
  for (JsonObject& entry : o.objects("layers")) {
    Layer layer;
    layer.name = entry.text("name");
    if (!is_word(layer.name)) entry.fail("name", layer.name.substr(0, 40), "letters, digits, '_' and '-'");
    const std::string files = entry.text("files");
    layer.prefix = files.ends_with(kNumber) ? files.substr(0, files.size() - kNumber.size()) : "";
    if (!is_word(layer.prefix)) entry.fail("files", files.substr(0, 40), "a name such as depth_%06d.exr");
    for (const Layer& other : all)
      if (other.name == layer.name || other.prefix == layer.prefix)
        entry.fail(other.name == layer.name ? "name" : "files", other.name == layer.name ? layer.name : files,
                   "one that no other layer has");
    const Json& channels = entry.any("channels");
    if (!channels.is_array() || channels.empty() || channels.size() > kMaxBands)
      entry.fail("channels", channels.is_array() ? fmt::format("{} channels", channels.size()) : "no list",
                 fmt::format("a list of 1 to {} names", kMaxBands));
    for (const Json& channel : channels) {
      if (!channel.is_string() || !is_word(channel.get<std::string>()))
        entry.fail("channels", channel.dump(-1, ' ', true, Json::error_handler_t::replace).substr(0, 40),
                   "letters, digits, '_' and '-'");
      if (std::ranges::find(layer.channels, channel.get<std::string>()) != layer.channels.end())
        entry.fail("channels", channel.get<std::string>() + " twice", "different names");
      layer.channels.push_back(channel.get<std::string>());
    }
    layer.unit = entry.text("unit");
    layer.per_interval = entry.one_of("at", {"instant", "interval"}) == "interval";
    entry.done();
    all.push_back(std::move(layer));
    if (all.size() > kMaxLayers) o.fail("layers", "more", fmt::format("at most {}", kMaxLayers - 1));
  }
  return all;
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
  info.fnumber = o.maybe_number("fnumber", {0.1, 1e4});
  if (info.fnumber && info.quantity != Quantity::radiance) o.fail("fnumber", "irradiance", "radiance");
  if (o.has("subpixels")) info.subpixels = static_cast<int>(o.integer("subpixels", 1, kMaxSubpixels));
  if (std::popcount(static_cast<unsigned>(info.subpixels)) != 1)
    o.fail("subpixels", std::to_string(info.subpixels), "1, 2 or 4");
  if (std::max(info.file_width(), info.file_height()) > kMaxSide)
    o.fail("subpixels", fmt::format("{}x{} in all", info.file_width(), info.file_height()),
           fmt::format("at most {}", kMaxSide));
  info.has_between = o.boolean_or("between", false);
  info.has_light = o.boolean_or("light", true);
  info.has_noise = o.boolean_or("noise", false);
  for (JsonObject& band : o.objects("bands")) {
    const Band b{band.number("lambda_nm", {100, 20000}), band.number("weight_nm", {0, 1e6})};
    if (!info.bands.empty() && b.lambda_nm < info.bands.back().lambda_nm + 2 * kSameLambda_nm)
      band.fail("lambda_nm", fmt::format("{}", b.lambda_nm), "increasing wavelengths");
    info.bands.push_back(b);
    band.done();
  }
  if (info.bands.empty() || info.bands.size() > kMaxBands)
    o.fail("bands", fmt::format("{} bands", info.bands.size()), fmt::format("1 to {}", kMaxBands));
  read_times(o, info);
  if (o.has("period_ns")) {
    info.period_ns = o.integer("period_ns", 1, std::int64_t{1} << 60);
    if (*info.period_ns <= info.times_ns.back() - info.times_ns.front())
      o.fail("period_ns", std::to_string(*info.period_ns), "more than the span of times_ns");
  }
  info.layers = layers(o, info);
  // Informational keys: validated, not used.
  if (o.has("lens")) o.object("lens");
  for (const char* key : {"scene", "render", "versions"}) o.object(key);
  o.done();
  return info;
}

const Layer& layer_of(const StackInfo& info, std::string_view name, const std::filesystem::path& folder) {
  for (const Layer& layer : info.layers)
    if (layer.name == name) return layer;
  std::string known;
  for (const Layer& layer : info.layers) known += (known.empty() ? "" : ", ") + layer.name;
  throw bad_input(folder.string(), "layer", std::string(name.substr(0, 40)), "one of " + known);
}

namespace {

std::int64_t intervals(const StackInfo& info) { return std::ssize(info.times_ns) - (info.period_ns ? 0 : 1); }

}  // namespace

std::int64_t planned_frames(const StackInfo& info, const Layer& layer) {
  return layer.per_interval ? intervals(info) : std::ssize(info.times_ns);
}

std::pair<std::int64_t, std::int64_t> interval_ns(const StackInfo& info, std::int64_t interval,
                                                  const std::filesystem::path& folder) {
  const std::int64_t instants = std::ssize(info.times_ns), count = intervals(info);
  if (interval < 0 || interval >= count)
    throw bad_input(folder.string(), "interval", std::to_string(interval), fmt::format("0 to {}", count - 1));
  const auto at = [&](std::int64_t i) { return info.times_ns[static_cast<std::size_t>(i)]; };
  return {at(interval), interval + 1 < instants ? at(interval + 1) : at(0) + *info.period_ns};
}

Json to_json(const Layer& layer) {
  return {{"name", layer.name},
          {"channels", layer.channels},
          {"unit", layer.unit},
          {"at", layer.per_interval ? "interval" : "instant"}};
}

std::size_t frame_values(const StackInfo& info, const Layer& layer) {
  return layer.channels.size() * static_cast<std::size_t>(info.file_height()) *
         static_cast<std::size_t>(info.file_width());
}

}  // namespace pecs::sensor
