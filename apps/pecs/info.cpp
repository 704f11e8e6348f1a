// pecs info: prints the properties of an event file or an EXR stack.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>

#include "commands.h"
#include "help.h"
#include "pecs/events/format.h"
#include "pecs/events/summary.h"
#include "pecs/sensor/stack.h"
#include "read_arguments.h"
#include "units.h"

namespace pecs::app {
namespace {

Json event_file_info(const std::string& path, const std::optional<std::string>& format,
                     const events::ReadOptions& options) {
  const events::Codec& codec = events::codec_of_file(path, format);
  const auto reader = events::open_reader(codec, path, options);
  events::Summary summary;
  std::vector<events::Event> block(1 << 16);
  while (const std::size_t n = reader->read(block)) summary.add(std::span(block).first(n));
  const events::StreamInfo& info = reader->info();
  Json out = summary.json(info.width, info.height);
  out["format"] = codec.name;
  out["width"] = info.width;
  out["height"] = info.height;
  out["camera"] = info.camera;
  if (info.frames) out["frames"] = info.frames;
  return out;
}

// Bands with the range of their values in the first frame, times, and the render's description in stack.json.
Json stack_info(const std::string& path, std::optional<double> fps) {
  const sensor::StackReader stack(path, {fps, {}, {}});
  const sensor::StackInfo& info = stack.info();
  const std::vector<float> frame = info.has_light ? stack.read_frame(0) : std::vector<float>{};
  const auto plane = static_cast<std::ptrdiff_t>(frame.size() / info.bands.size());
  Json bands = Json::array();
  for (std::size_t b = 0; info.has_light && b < info.bands.size(); ++b) {
    const auto first = frame.begin() + static_cast<std::ptrdiff_t>(b) * plane;
    double sum = 0, low = *first, high = *first;
    for (auto v = first; v != first + plane; ++v) {
      sum += *v;
      low = std::fmin(low, *v);  // ignores NaN
      high = std::fmax(high, *v);
    }
    bands.push_back({{"lambda_nm", info.bands[b].lambda_nm},
                     {"weight_nm", info.bands[b].weight_nm},
                     {"first_frame", {{"min", low}, {"mean", sum / static_cast<double>(plane)}, {"max", high}}}});
  }
  Json layers = Json::array();
  for (const sensor::Layer& layer : info.layers) layers.push_back(to_json(layer));
  Json out = {{"format", "exr-stack"},
              {"width", info.width},
              {"height", info.height},
              {"quantity", name_of(info.quantity)},
              {"unit", unit_of(info.quantity)},
              {"bands", bands},
              {"layers", layers},
              {"frames", stack.frames()},
              {"frames_planned", info.times_ns.size()},
              {"t_first_us", static_cast<double>(info.times_ns.front()) * 1e-3},
              {"t_last_us", static_cast<double>(info.times_ns[static_cast<std::size_t>(stack.frames()) - 1]) * 1e-3},
              {"period_us", info.period_ns ? Json(static_cast<double>(*info.period_ns) * 1e-3) : Json()}};
  if (const auto file = std::filesystem::path(path) / "stack.json"; std::filesystem::exists(file)) {
    const Json json = parse_json_file(file, std::size_t{64} << 20);
    for (const char* key : {"lens", "scene", "render", "versions"})
      if (json.contains(key)) out[key] = json[key];
  }
  return out;
}

// Illuminance of the render: of a .blend on the median visible surface, of a scene folder on its target.
std::optional<double> lux_of(const Json& stack) {
  for (const char* place : {"/render/lux", "/scene/parameters/illuminance_lux"})
    if (const Json::json_pointer key(place); stack.contains(key) && stack[key].is_number()) return stack[key];
  return {};
}

void print_stack(const std::string& path, const Json& info) {
  fmt::print("{}: EXR stack of spectral {}, {}x{} pixels\n", path, info["quantity"].get<std::string>(),
             info["width"].get<int>(), info["height"].get<int>());
  fmt::print("frames       {} of {}\n", info["frames"].get<std::int64_t>(), info["frames_planned"].get<std::int64_t>());
  fmt::print("time         {} to {} us\n", info["t_first_us"].get<double>(), info["t_last_us"].get<double>());
  if (!info["period_us"].is_null()) fmt::print("period       {} us\n", info["period_us"].get<double>());
  for (const char* key : {"lens", "scene"})
    if (info.contains(key) && info[key].is_object() && info[key].contains("name") && info[key]["name"].is_string())
      fmt::print("{:<12} {}{}\n", key, info[key]["name"].get<std::string>(),
                 info[key].value("fnumber", Json()).is_number()
                     ? fmt::format(", at f/{:.3g}", info[key]["fnumber"].get<double>())
                     : "");
  if (const auto lux = lux_of(info)) fmt::print("light        {:g} lux\n", *lux);
  for (const Json& layer : info["layers"])
    if (layer["name"] != sensor::kLight)
      fmt::print("layer        {}: {} [{}], per {}\n", layer["name"].get<std::string>(),
                 fmt::join(layer["channels"].get<std::vector<std::string>>(), ", "), layer["unit"].get<std::string>(),
                 layer["at"].get<std::string>());
  if (info["bands"].empty()) return;  // layers alone
  fmt::print("band [nm]    weight [nm]    first frame: least, mean, greatest [{}]\n", info["unit"].get<std::string>());
  for (const Json& band : info["bands"]) {
    const Json& v = band["first_frame"];
    fmt::print("{:<12.2f} {:<14.4g} {:.4g} {:.4g} {:.4g}\n", band["lambda_nm"].get<double>(),
               band["weight_nm"].get<double>(), v["min"].get<double>(), v["mean"].get<double>(),
               v["max"].get<double>());
  }
}

void print_events(const std::string& path, const Json& info) {
  fmt::print("{}: {}, {}x{} pixels{}\n", path, info["format"].get<std::string>(), info["width"].get<int>(),
             info["height"].get<int>(), info["camera"] == "" ? "" : ", " + info["camera"].get<std::string>());
  fmt::print("events       {}\n", info["events"].get<std::uint64_t>());
  if (info.contains("frames")) fmt::print("frames       {}\n", info["frames"].get<std::int64_t>());
  if (info["t_first_us"].is_null()) return;
  fmt::print("time         {} to {} us, {:.6f} s\n", info["t_first_us"].get<std::int64_t>(),
             info["t_last_us"].get<std::int64_t>(), info["duration_us"].get<double>() * 1e-6);
  fmt::print("ON fraction  {:.4f}\n", info["on_fraction"].get<double>());
  if (!info["event_rate_hz"].is_null())
    fmt::print("mean rate    {:.4g} events/s\n", info["event_rate_hz"].get<double>());
  if (!info["event_rate_per_pixel_hz"].is_null())
    fmt::print("             {:.4g} events/s per pixel\n", info["event_rate_per_pixel_hz"].get<double>());
  if (const auto n = info["time_reversals"].get<std::uint64_t>(); n > 0) fmt::print("decreasing timestamps: {}\n", n);
}

}  // namespace

void add_info(CLI::App& app, Console&) {
  struct Options {
    std::string path;
    std::optional<std::string> format;
    events::ReadOptions read;
    std::optional<double> fps;
    bool json = false;
  };
  const auto o = std::make_shared<Options>();
  CLI::App* sub = app.add_subcommand("info", "print the properties of an event file or an EXR stack");
  sub->add_option("FILE", o->path, "event file, or folder of an EXR stack")->required();
  sub->add_option("--format", o->format, "format of FILE, if it cannot be detected");
  add_read_options(*sub, o->read);
  add_quantity(*sub, "--fps", o->fps, "Hz", "frames per second of a stack without stack.json")->check(positive());
  sub->add_flag("--json", o->json, "machine-readable output");
  add_examples(*sub, {"pecs info events.raw", "pecs info out/stack --json"});
  sub->callback([o] {
    const bool is_stack = std::filesystem::is_directory(o->path);
    if (is_stack && (o->format || o->read.time_unit || o->read.width > 0))
      throw bad_usage(o->format ? "--format" : o->read.time_unit ? "--time-unit" : "--size", o->path, "an event file");
    if (o->fps && !is_stack) throw bad_usage("--fps", o->path, "a stack without stack.json");
    const Json info = is_stack ? stack_info(o->path, o->fps) : event_file_info(o->path, o->format, o->read);
    if (o->json) return print_json(info);
    (is_stack ? print_stack : print_events)(o->path, info);
  });
}

}  // namespace pecs::app
