#include "pecs/sensor/sense_options.h"

#include <fmt/format.h>

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

void read_sensor_options(JsonObject& o, SenseOptions& out) {
  out.chip = o.text_or("chip", out.chip);
  if (o.has("set")) out.overrides = overrides_from(o.any("set"));
  if (o.has("bias"))
    for (const auto& [name, offset] : numbers_of(o.any("bias"), "bias"))
      out.biases[name.starts_with("bias_") ? name.substr(5) : name] = offset;
  if (o.has("bias_file")) out.bias_file = o.text("bias_file");
  out.no_noise = o.boolean_or("no_noise", false);
  out.seed = static_cast<std::uint64_t>(
      o.integer_or("seed", static_cast<std::int64_t>(out.seed), 0, static_cast<std::int64_t>(kLargestSeed)));
  out.threads = static_cast<int>(o.integer_or("threads", 0, 0, 1024));
  out.model.name = o.text_or("model", out.model.name);
  if (o.has("param")) out.model.parameters = numbers_of(o.any("param"), "param");
  out.ideal_readout = o.has("readout") && o.one_of("readout", {"chip", "ideal"}) == "ideal";
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
  out.model.white_fa = o.number_or("white_a", 0, {1e-30, 1}) * 1e15;
  const std::string bands = o.text_or("bands", "all");
  if (const auto n = monte_carlo_bands(bands))
    out.monte_carlo_bands = *n;
  else
    o.fail("bands", bands, "\"all\" or \"mc:N\"");
  if (o.has("labels")) out.labels = o.text("labels");
  if (o.has("dropped")) out.dropped = o.text("dropped");
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
