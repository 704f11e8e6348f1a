#include "pecs/sensor/sense_options.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "pecs/data_dir.h"
#include "pecs/error.h"
#include "pecs/text.h"

namespace pecs::sensor {
namespace {

std::map<std::string, double> numbers_of(const Json& object, const std::string& name) {
  if (!object.is_object()) throw bad_input("options", name, object.dump().substr(0, 40), "{\"key\": number}");
  std::map<std::string, double> out;
  for (const auto& [key, value] : object.items()) {
    if (!value.is_number())
      throw bad_input("options", fmt::format("{}.{}", name, key), value.dump().substr(0, 40), "a number");
    out[key] = value.get<double>();
  }
  return out;
}

}  // namespace

std::optional<int> monte_carlo_bands(std::string_view text) {
  if (text == "all") return 0;
  if (!text.starts_with("mc:")) return {};
  const auto n = number_from<int>(text.substr(3));
  return n && *n >= 1 && *n <= 999'999 ? n : std::nullopt;
}

std::vector<std::string> overrides_from(const Json& values) {
  std::vector<std::string> out;
  for (const auto& [key, value] : numbers_of(values, "set")) out.push_back(key + "=" + Json(value).dump());
  return out;
}

Preset load_preset(const std::string& name) {
  const std::filesystem::path path = find_data("sensor/presets", name);
  const Json json = parse_json_file(path);
  JsonObject o(json, path.string());
  o.integer("pecs_preset", 1, 1);
  Preset out{o.text("name"),
             o.text("description"),
             o.text("source"),
             o.one_of("model", model_names()),
             numbers_of(o.any("set"), "set"),
             numbers_of(o.any("param"), "param")};
  o.done();
  return out;
}

Json presets() {
  std::vector<std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator(data_dir("sensor/presets")))
    if (entry.path().extension() == ".json") files.push_back(entry.path().string());
  std::ranges::sort(files);
  Json out = Json::array();
  for (const std::string& file : files) {
    const Preset p = load_preset(file);
    out.push_back({{"name", p.name},
                   {"description", p.description},
                   {"source", p.source},
                   {"model", p.model},
                   {"set", p.set},
                   {"param", p.param}});
  }
  return out;
}

void apply_preset(SenseOptions& options, bool model_given, bool readout_given) {
  const Preset preset = load_preset(options.preset);
  if (model_given && options.model.name != preset.model)
    throw Error(ExitCode::usage, fmt::format("--preset {}: it is of model {}, and --model is {}; leave one out",
                                             preset.name, preset.model, options.model.name));
  options.model.name = preset.model;
  for (const auto& [key, value] : preset.param.items()) options.model.parameters.emplace(key, value.get<double>());
  const std::vector<std::string> given = options.overrides;
  for (const std::string& text : overrides_from(preset.set)) {
    const std::string key = text.substr(0, text.find('=') + 1);
    if (std::ranges::none_of(given, [&](const std::string& own) { return own.starts_with(key); }))
      options.overrides.push_back(text);
  }
  if (!readout_given) options.ideal_readout = true;
}

void read_sensor_options(JsonObject& o, SenseOptions& out) {
  out.chip = o.text_or("chip", out.chip);
  if (o.has("set")) out.overrides = overrides_from(o.any("set"));
  if (o.has("bias"))
    for (const auto& [name, offset] : numbers_of(o.any("bias"), "bias"))
      if (!out.biases.insert({name.starts_with("bias_") ? name.substr(5) : name, offset}).second)
        o.fail("bias", name + " and the same without bias_", "each bias once");
  if (o.has("bias_file")) out.bias_file = o.text("bias_file");
  out.no_noise = o.boolean_or("no_noise", false);
  out.seed = static_cast<std::uint64_t>(
      o.integer_or("seed", static_cast<std::int64_t>(out.seed), 0, static_cast<std::int64_t>(kLargestSeed)));
  out.threads = static_cast<int>(o.integer_or("threads", 0, 0, 1024));
  out.model.name = o.text_or("model", out.model.name);
  if (o.has("param")) out.model.parameters = numbers_of(o.any("param"), "param");
  out.ideal_readout = o.has("readout") && o.one_of("readout", {"chip", "ideal"}) == "ideal";
  if (o.has("preset")) {
    out.preset = o.text("preset");
    apply_preset(out, o.has("model"), o.has("readout"));
  }
  out.stages = read_stage_options(o);
}

PhotocurrentOptions read_photocurrent_options(JsonObject& o) {
  constexpr double kLeast = 1e-30, kMost = 1e30;
  return {o.maybe_number("fnumber", {0.1, 1e4}), o.maybe_number("gain", {kLeast, kMost}),
          o.maybe_number("photocurrent_a", {kLeast, 1})};
}

SenseOptions sense_options(JsonObject o) {
  SenseOptions out;
  read_sensor_options(o, out);
  out.light = read_photocurrent_options(o);
  if (o.has("format")) out.format = o.text("format");
  out.times.fps = o.maybe_number("fps", {1e-9, 1e9});
  if (o.has("times_us")) out.times.file_us = o.text("times_us");
  if (o.has("time_unit")) out.times.unit = time_unit_from(o.text("time_unit"));
  out.model.white_fa = o.number_or("white_a", 0, {1e-30, 1}) * 1e15;
  const std::string bands = o.text_or("bands", "all");
  if (const auto n = monte_carlo_bands(bands))
    out.monte_carlo_bands = *n;
  else
    o.fail("bands", bands, "\"all\" or \"mc:N\"");
  if (o.has("labels")) out.labels = o.text("labels");
  if (o.has("dropped")) out.dropped = o.text("dropped");
  if (o.has("frames")) out.frames = o.text("frames");
  out.motion = o.boolean_or("motion", true);
  out.render_noise = o.number_or("render_noise", out.render_noise, {0, kMostRenderNoise});
  out.window.warmup_loops = static_cast<int>(o.integer_or("warmup_loops", 0, 0, 1000000));
  out.window.warmup_us = o.integer_or("warmup_us", 0, 0, kLongestWarmup_us);
  out.window.start_us = o.integer_or("start_us", 0, 0, kLongestTime_us);
  if (o.has("duration_us")) out.window.duration_us = o.integer("duration_us", 1, kLongestTime_us);
  o.done();
  return out;
}

}  // namespace pecs::sensor
