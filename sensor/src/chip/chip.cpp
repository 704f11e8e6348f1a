#include "pecs/sensor/chip.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <ranges>
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
    Value{"readout_vector_px", "px", 1, 8192, &Chip::readout_vector_px},
    Value{"readout_idle_s", "s", 0, 1e-3, &Chip::readout_idle_s},
    Value{"readout_columns", "bit", 0, 1, &Chip::readout_columns},
    Value{"timestamp_s", "s", 1e-6, 1e-2, &Chip::timestamp_s},
    Value{"clock_jitter_s", "s", 0, 1e-3, &Chip::clock_jitter_s},
    Value{"frame_period_s", "s", 1e-4, 100, &Chip::frame_period_s},
    Value{"frame_exposure_s", "s", 1e-6, 100, &Chip::frame_exposure_s},
    Value{"frame_row_s", "s", 0, 1e-2, &Chip::frame_row_s},
    Value{"frame_dead_s", "s", 0, 1, &Chip::frame_dead_s},
    Value{"frame_gain_e", "electron/DN", 1e-3, 1e6, &Chip::frame_gain_e},
    Value{"frame_gain_mismatch", "1", 0, 0.3, &Chip::frame_gain_mismatch},
    Value{"frame_offset_dn", "DN", 0, 65535, &Chip::frame_offset_dn},
    Value{"frame_offset_mismatch_dn", "DN", 0, 65535, &Chip::frame_offset_mismatch_dn},
    Value{"frame_read_noise_e", "electron", 0, 1e6, &Chip::frame_read_noise_e},
    Value{"frame_dark_hz", "electron/s", 0, 1e9, &Chip::frame_dark_hz},
    Value{"frame_adc_bits", "bit", 1, 16, &Chip::frame_adc_bits},
    Value{"frame_auto_mean", "1", 0, 1, &Chip::frame_auto_mean},
    Value{"frame_auto_gain", "1", 1e-3, 10, &Chip::frame_auto_gain},
    Value{"frame_auto_libcaer", "bit", 0, 1, &Chip::frame_auto_libcaer},
    Value{"frame_step", "ln", 0, 5, &Chip::frame_step},
    Value{"frame_step_spread", "1", 0, 2, &Chip::frame_step_spread},
    Value{"frame_step_slow", "ln", 0, 5, &Chip::frame_step_slow},
    Value{"frame_step_slow_s", "s", 1e-6, 10, &Chip::frame_step_slow_s},
};
constexpr std::size_t kFrameValues = 18;  // the last ones, those of the object `frames`, which a profile may lack

bool is_whole(double v) { return v == std::floor(v); }

// Whether `v` may be the value of `of`: pixels and bits are whole.
bool wants_whole(const Value& of) { return of.unit == std::string_view("px") || of.unit == std::string_view("bit"); }
bool is_allowed(const Value& of, double v, Range range) {
  return v >= range.min && v <= range.max && (!wants_whole(of) || is_whole(v));
}
std::string allowed(const Value& of, Range range) {
  const std::string unit = of.unit == std::string_view("1") ? "" : fmt::format(" {}", of.unit);
  return fmt::format("{} in [{}, {}]{}", wants_whole(of) ? "a whole number" : "a number", range.min, range.max, unit);
}

Spectrum read_spectrum(JsonObject o) {
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

void read_values(JsonObject values, std::span<const Value> all, Chip& chip) {
  for (const Value& v : all) {
    JsonObject entry = values.object(v.key);
    const std::vector<double> range = entry.numbers("range", {v.min, v.max});
    if (range.size() != 2 || range[0] > range[1]) entry.fail("range", "no range", "[min, max]");
    chip.*v.member = entry.number("value", {range[0], range[1]});
    if (const Range known{range[0], range[1]}; !is_allowed(v, chip.*v.member, known))
      entry.fail("value", fmt::format("{}", chip.*v.member), allowed(v, known));
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
}

std::shared_ptr<const Mosaic> read_mosaic(JsonObject o) {
  Mosaic mosaic;
  JsonObject filters = o.object("filters");
  const Json& pattern = o.any("pattern");
  if (!pattern.is_array() || pattern.empty()) o.fail("pattern", "no rows", "rows of letters, [\"RG\", \"GB\"]");
  for (const Json& row : pattern) {
    const std::string letters = row.is_string() ? row.get<std::string>() : "";
    if (letters.empty() || !std::ranges::all_of(letters, [](unsigned char c) { return std::isalpha(c); }) ||
        (!mosaic.pattern.empty() && letters.size() != mosaic.pattern[0].size()))
      o.fail("pattern", shortened(row.dump(), 40), "rows of letters, all of one length");
    std::vector<std::uint8_t>& indices = mosaic.pattern.emplace_back();
    for (const char letter : letters) {
      const std::string name(1, letter);
      auto at = std::ranges::find(mosaic.filters, name, &Mosaic::Filter::name);
      if (at == mosaic.filters.end()) at = mosaic.filters.insert(at, {name, read_spectrum(filters.object(name))});
      indices.push_back(static_cast<std::uint8_t>(at - mosaic.filters.begin()));
    }
  }
  filters.done();
  o.done();
  return std::make_shared<const Mosaic>(std::move(mosaic));
}

// The pixel map of docs/reference/sensor.md.
std::shared_ptr<const PixelMap> read_pixel_map(const std::filesystem::path& path) {
  const Json json = parse_json_file(path, std::size_t{256} << 20);
  JsonObject o(json, path.string());
  o.integer("pecs_pixel_map", 1, 1);
  o.text("source");
  PixelMap map;
  map.file = path.string();
  std::optional<std::size_t> pixels;
  if (o.has("region")) {
    const std::vector<double> region = o.numbers("region", {0, 8192});
    if (region.size() != 4 || region[2] < 1 || region[3] < 1 || !std::ranges::all_of(region, is_whole))
      o.fail("region", "no region", "[x, y, width, height] in whole pixels");
    map.x = static_cast<int>(region[0]), map.y = static_cast<int>(region[1]);
    map.width = static_cast<int>(region[2]), map.height = static_cast<int>(region[3]);
    pixels = static_cast<std::size_t>(map.width) * static_cast<std::size_t>(map.height);
  }
  const auto read_pair = [&](const char* on, const char* off, Range range, auto& of_on, auto& of_off) {
    if (!o.has(on) && !o.has(off)) return;
    for (const auto& [key, values] : {std::pair(on, &of_on), std::pair(off, &of_off)}) {
      const std::vector<double> read = o.numbers(key, range);
      values->assign(read.begin(), read.end());
      if (!pixels) pixels = read.size();
      if (read.empty() || read.size() != *pixels)
        o.fail(key, fmt::format("{} values", read.size()), fmt::format("{}", std::max<std::size_t>(1, *pixels)));
    }
  };
  read_pair("threshold_on", "threshold_off", {0.1, 10}, map.threshold_on, map.threshold_off);
  read_pair("background_on_hz", "background_off_hz", {0, 1e4}, map.background_on_hz, map.background_off_hz);
  if (o.has("hot_pixels")) {
    map.hot_pixels.emplace();
    for (const Json& entry : o.any("hot_pixels")) {
      if (!entry.is_array() || entry.size() != 3 ||
          !std::ranges::all_of(
              entry, [](const Json& v) { return v.is_number() && v.get<double>() >= 0 && v.get<double>() <= 1e4; }) ||
          !is_whole(entry[0].get<double>()) || !is_whole(entry[1].get<double>()))
        o.fail("hot_pixels", entry.dump(), "[x, y, Hz], x and y whole");
      map.hot_pixels->push_back({entry[0].get<int>(), entry[1].get<int>(), entry[2].get<double>()});
    }
  }
  o.done();
  return std::make_shared<const PixelMap>(std::move(map));
}

}  // namespace

namespace {

// A profile's JSON; of one that is based on another, its own values, frames and parts in place of the other's.
Json read_profile(const std::filesystem::path& path) {
  Json own = parse_json_file(path);
  if (!own.is_object() || !own.contains("based_on")) return own;
  const std::filesystem::path base_path = find_data("sensor/chips", JsonObject(own, path.string()).text("based_on"));
  Json base = parse_json_file(base_path);
  if (!base.is_object() || base.contains("based_on") || !base["values"].is_object() || base.contains("pixel_map"))
    throw bad_input(path.string(), "based_on", base_path.string(), "a profile with all values and no pixel map");
  own.erase("based_on");
  for (auto& [key, part] : own.items()) {
    if ((key == "values" || key == "frames") && part.is_object())
      base[key].update(part);
    else
      base[key] = std::move(part);
  }
  return base;
}

}  // namespace

Chip load_chip(const std::string& name, const std::vector<std::string>& overrides, const BiasSettings& biases) {
  const std::filesystem::path path = find_data("sensor/chips", name);
  const Json json = read_profile(path);
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
  chip.relative_qe = read_spectrum(o.object("relative_qe"));
  if (o.has("mosaic")) chip.mosaic = read_mosaic(o.object("mosaic"));

  read_values(o.object("values"), std::span(kValues).first(kValues.size() - kFrameValues), chip);
  if (o.has("frames")) read_values(o.object("frames"), std::span(kValues).last(kFrameValues), chip);
  if (o.has("biases")) chip.biases = read_biases(o.object("biases"), chip.ranges);
  if (o.has("pixel_map")) chip.pixel_map = read_pixel_map(path.parent_path() / o.text("pixel_map"));
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
                                               fmt::join(std::views::keys(chip.ranges), ", ")));
    const auto value = number_from<double>(std::string_view(text).substr(equals + 1));
    const Value& of = *std::ranges::find(kValues, key, &Value::key);
    if (!value || !is_allowed(of, *value, known->second))
      throw bad_usage("--set " + key, text.substr(equals + 1), allowed(of, known->second));
    chip.*of.member = *value;
  }
  apply_biases(chip, biases, overrides);
  if (const double busy_s = chip.frame_exposure_s + chip.frame_dead_s; busy_s > chip.frame_period_s * (1 + 1e-9))
    throw Error(ExitCode::usage, fmt::format("{}: frame_period_s: got {}, wanted at least {}, the sum of "
                                             "frame_exposure_s and frame_dead_s",
                                             chip.name, chip.frame_period_s, busy_s));
  return chip;
}

std::optional<std::size_t> PixelMap::index(int px, int py, double drawn) const {
  const std::size_t size = std::max(threshold_on.size(), background_on_hz.size());
  if (width == 0)
    return size ? std::optional(static_cast<std::size_t>(drawn * static_cast<double>(size))) : std::nullopt;
  if (px < x || py < y || px >= x + width || py >= y + height) return std::nullopt;
  return static_cast<std::size_t>(py - y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(px - x);
}

Chip without_noise(Chip chip) {
  chip.noise_std = chip.leak_rate_hz = chip.background_on_hz = chip.background_off_hz = chip.threshold_mismatch =
      chip.hot_pixel_fraction = chip.frame_step_spread = 0;
  chip.pixel_map = nullptr;
  return chip;
}

void check_fits(const Chip& chip, int width, int height, const std::string& source, const std::string& remedy) {
  if ((chip.width > 0 && width > chip.width) || (chip.height > 0 && height > chip.height))
    throw bad_input(source, "size", fmt::format("{}x{}", width, height),
                    fmt::format("at most {}'s {}x{}{}", chip.name, chip.width, chip.height, remedy));
}

void take_frames(Chip& chip, bool takes, const std::string& option, const std::vector<std::string>& overrides) {
  if (takes && !chip.has_frames()) throw bad_usage(option, "chip " + chip.name, "one with frames (pecs chips)");
  chip.takes_frames = takes;
  for (const std::string& text : overrides) {
    if (text.starts_with("frame_") && !takes)
      throw Error(ExitCode::usage, fmt::format("--set {}: has no effect without {}", text, option));
    if (text.starts_with("frame_auto_gain=") && !(chip.frame_auto_mean > 0))
      throw Error(ExitCode::usage, fmt::format("--set {}: has no effect without frame_auto_mean", text));
  }
  if (chip.frame_auto_libcaer > 0 && chip.frame_auto_mean > 0)
    throw bad_usage("frame_auto_mean", fmt::format("{}", chip.frame_auto_mean), "0 with frame_auto_libcaer");
}

Json chip_to_json(const Chip& chip) {
  Json out = {{"name", chip.name}, {"description", chip.description}};
  for (const Value& v : kValues)
    if (chip.ranges.contains(v.key)) out["values"][v.key] = {{"value", chip.*v.member}, {"unit", v.unit}};
  out["relative_qe"] = {{"lambda_nm", chip.relative_qe.lambda_nm}, {"value", chip.relative_qe.value}};
  if (chip.mosaic) {
    Json& mosaic = out["mosaic"];
    for (const Mosaic::Filter& f : chip.mosaic->filters)
      mosaic["filters"][f.name] = {{"lambda_nm", f.transmittance.lambda_nm}, {"value", f.transmittance.value}};
    for (const auto& row : chip.mosaic->pattern) {
      std::string letters;
      for (const std::uint8_t filter : row) letters += chip.mosaic->filters[filter].name;
      mosaic["pattern"].push_back(letters);
    }
  }
  if (!chip.trade_names.empty()) out["trade_names"] = chip.trade_names;
  if (!chip.set_biases.empty()) out["biases"] = chip.set_biases;
  if (chip.pixel_map) out["pixel_map"] = chip.pixel_map->file;
  return out;
}

}  // namespace pecs::sensor
