#include "pecs/sensor/chip.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <array>
#include <map>
#include <set>

#include "pecs/data_dir.h"
#include "pecs/error.h"
#include "pecs/text.h"

namespace pecs::sensor {
namespace {

// The keys of a profile: the only list of them. The limits are those of the models; a profile's ranges are narrower.
struct Value {
  const char* key;
  const char* unit;
  double min, max;
  double Chip::* member;
};
constexpr std::array kValues = {
    Value{"width", "px", 0, 8192, &Chip::width},
    Value{"height", "px", 0, 8192, &Chip::height},
    Value{"pixel_pitch_m", "m", 1e-7, 1e-3, &Chip::pixel_pitch_m},
    Value{"fill_factor", "1", 0.01, 1, &Chip::fill_factor},
    Value{"peak_qe", "electron/photon", 0.01, 1, &Chip::peak_qe},
    Value{"dark_current_a", "A", 0, 1e-6, &Chip::dark_current_a},
    Value{"corner_hz_per_a", "Hz/A", 0, 1e18, &Chip::corner_hz_per_a},
    Value{"amplifier_cutoff_hz", "Hz", 0, 1e9, &Chip::amplifier_cutoff_hz},
    Value{"noise_std", "ln", 0, 1, &Chip::noise_std},
    Value{"contrast_threshold_on", "ln", 1e-3, 5, &Chip::contrast_threshold_on},
    Value{"contrast_threshold_off", "ln", 1e-3, 5, &Chip::contrast_threshold_off},
    Value{"threshold_mismatch", "1", 0, 0.3, &Chip::threshold_mismatch},
    Value{"refractory_period_s", "s", 0, 1, &Chip::refractory_period_s},
    Value{"leak_rate_hz", "Hz", 0, 100, &Chip::leak_rate_hz},
    Value{"background_on_hz", "Hz", 0, 100, &Chip::background_on_hz},
    Value{"background_off_hz", "Hz", 0, 100, &Chip::background_off_hz},
    Value{"hot_pixel_fraction", "1", 0, 1, &Chip::hot_pixel_fraction},
    Value{"hot_pixel_hz", "Hz", 0, 1e4, &Chip::hot_pixel_hz},
    Value{"readout_rate_hz", "Hz", 0, 1e12, &Chip::readout_rate_hz},
    Value{"readout_row_s", "s", 0, 1e-3, &Chip::readout_row_s},
    Value{"readout_group_rows", "px", 1, 8192, &Chip::readout_group_rows},
    Value{"timestamp_s", "s", 1e-6, 1e-2, &Chip::timestamp_s},
    Value{"clock_jitter_s", "s", 0, 1e-3, &Chip::clock_jitter_s},
};

std::vector<std::string> keys() {
  std::vector<std::string> out;
  for (const Value& v : kValues) out.emplace_back(v.key);
  return out;
}

Spectrum read_qe(JsonObject o) {
  Spectrum s{o.numbers("lambda_nm", {100, 20000}), o.numbers("value", {0, 1})};
  if (s.lambda_nm.size() < 2 || s.lambda_nm.size() != s.value.size())
    o.fail("value", fmt::format("{} values for {} wavelengths", s.value.size(), s.lambda_nm.size()),
           "as many, at least 2");
  for (std::size_t i = 1; i < s.lambda_nm.size(); ++i)
    if (s.lambda_nm[i] <= s.lambda_nm[i - 1])
      o.fail(fmt::format("lambda_nm[{}]", i), fmt::format("{}", s.lambda_nm[i]), "increasing wavelengths");
  o.text("source");
  o.done();
  return s;
}

// {"pecs_noise_table": 1, "source": …, "on_hz": […], "off_hz": […], "width": W, "height": H}, the last two or neither.
std::shared_ptr<const NoiseTable> read_noise_table(const std::filesystem::path& path) {
  const Json json = parse_json_file(path, std::size_t{256} << 20);
  JsonObject o(json, path.string());
  o.integer("pecs_noise_table", 1, 1);
  o.text("source");
  NoiseTable t;
  t.file = path.string();
  t.width = static_cast<int>(o.integer_or("width", 0, 1, 8192));
  t.height = static_cast<int>(o.integer_or("height", 0, 1, 8192));
  for (const auto& [key, rates] : {std::pair("on_hz", &t.on_hz), std::pair("off_hz", &t.off_hz)}) {
    const std::vector<double> hz = o.numbers(key, {0, 1e4});
    rates->assign(hz.begin(), hz.end());
  }
  o.done();
  const auto pixels = static_cast<std::size_t>(t.width) * static_cast<std::size_t>(t.height);
  if ((t.width == 0) != (t.height == 0)) o.fail(t.width ? "height" : "width", "nothing", "both or neither");
  if (t.on_hz.empty() || t.on_hz.size() != t.off_hz.size() || (pixels && pixels != t.on_hz.size()))
    o.fail("on_hz", fmt::format("{} and {} rates", t.on_hz.size(), t.off_hz.size()),
           pixels ? fmt::format("{} each", pixels) : "as many, at least 1");
  return std::make_shared<const NoiseTable>(std::move(t));
}

}  // namespace

Chip load_chip(const std::string& name, const std::vector<std::string>& overrides, const BiasSettings& biases) {
  const std::filesystem::path path = find_data("sensor/chips", name);
  const Json json = parse_json_file(path);
  JsonObject o(json, path.string());
  o.integer("pecs_chip", 1, 1);
  Chip chip;
  chip.name = o.text("name");
  chip.description = o.text("description");
  if (o.has("trade_names"))
    for (const Json& trade_name : o.any("trade_names")) {
      if (!trade_name.is_string()) o.fail("trade_names", trade_name.dump(), "texts");
      chip.trade_names.push_back(trade_name);
    }
  chip.relative_qe = read_qe(o.object("relative_qe"));

  JsonObject values = o.object("values");
  for (const Value& v : kValues) {
    JsonObject entry = values.object(v.key);
    const std::vector<double> range = entry.numbers("range", {v.min, v.max});
    if (range.size() != 2 || range[0] > range[1]) entry.fail("range", "no range", "[min, max]");
    chip.*v.member = entry.number("value", {range[0], range[1]});
    entry.one_of("unit", {v.unit});
    if (entry.has("interval")) {  // where the true value lies, as far as the sources know
      const std::vector<double> interval = entry.numbers("interval", {range[0], range[1]});
      if (interval.size() != 2 || interval[0] > interval[1]) entry.fail("interval", "no interval", "[least, most]");
    }
    chip.sources[v.key] = entry.text("source");
    entry.done();
    chip.ranges[v.key] = {range[0], range[1]};
  }
  values.done();
  if (o.has("biases")) chip.biases = read_biases(o.object("biases"), chip.ranges);
  if (o.has("noise_table")) chip.noise_table = read_noise_table(path.parent_path() / o.text("noise_table"));
  o.done();

  std::set<std::string> given;
  for (const std::string& text : overrides) {
    const auto equals = text.find('=');
    const std::string key = text.substr(0, equals);
    if (!given.insert(key).second)
      throw Error(ExitCode::usage, fmt::format("--set {}: {} is set twice; set it once", text, key));
    const auto known = chip.ranges.find(key);
    if (equals == std::string::npos || known == chip.ranges.end())
      throw Error(ExitCode::usage, fmt::format("--set {}: got an unknown key, wanted KEY=VALUE with one of {}", text,
                                               fmt::join(keys(), ", ")));
    const auto value = number_from<double>(std::string_view(text).substr(equals + 1));
    if (!value || !(*value >= known->second.min && *value <= known->second.max))
      throw Error(ExitCode::usage, fmt::format("--set {}: got {}, wanted a number in [{}, {}]", key,
                                               text.substr(equals + 1), known->second.min, known->second.max));
    for (const Value& v : kValues)
      if (key == v.key) chip.*v.member = *value;
  }
  apply_biases(chip, biases, overrides);
  return chip;
}

Chip without_noise(Chip chip) {
  chip.noise_std = chip.leak_rate_hz = chip.background_on_hz = chip.background_off_hz = chip.threshold_mismatch =
      chip.hot_pixel_fraction = 0;
  chip.noise_table = nullptr;
  return chip;
}

void check_fits(const Chip& chip, int width, int height, const std::string& source) {
  if ((chip.width > 0 && width > chip.width) || (chip.height > 0 && height > chip.height))
    throw bad_input(source, "size", fmt::format("{}x{}", width, height),
                    fmt::format("at most {}'s {}x{}", chip.name, chip.width, chip.height));
}

Json chip_to_json(const Chip& chip) {
  Json out = {{"name", chip.name}, {"description", chip.description}};
  for (const Value& v : kValues) out["values"][v.key] = {{"value", chip.*v.member}, {"unit", v.unit}};
  out["relative_qe"] = {{"lambda_nm", chip.relative_qe.lambda_nm}, {"value", chip.relative_qe.value}};
  if (!chip.trade_names.empty()) out["trade_names"] = chip.trade_names;
  if (!chip.set_biases.empty()) out["biases"] = chip.set_biases;
  if (chip.noise_table) out["noise_table"] = chip.noise_table->file;
  return out;
}

}  // namespace pecs::sensor
