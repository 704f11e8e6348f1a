// Biases of Metavision's cameras, as offsets to factory settings: what a profile knows of them, their files, their
// effect.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/sensor/chip.h"
#include "pecs/text.h"

namespace pecs::sensor {
namespace {

std::string plain_name(const std::string& name) { return name.starts_with("bias_") ? name.substr(5) : name; }

Error wrong(const std::string& name, const std::string& text) {
  return Error(ExitCode::usage, fmt::format("bias {}: {}", name, text));
}

void add(BiasSettings& out, const std::string& name, double value) {
  if (!out.insert({plain_name(name), value}).second) throw wrong(plain_name(name), "is set twice; set it once");
}

double factor_at(const Bias& bias, double offset) {
  std::size_t i = 1;
  while (i + 1 < bias.offset.size() && bias.offset[i] < offset) ++i;
  const double part = (offset - bias.offset[i - 1]) / (bias.offset[i] - bias.offset[i - 1]);
  return std::exp((1 - part) * std::log(bias.factor[i - 1]) + part * std::log(bias.factor[i]));
}

double* threshold_of(Chip& chip, const std::string& key) {
  return key == "contrast_threshold_on" ? &chip.contrast_threshold_on : &chip.contrast_threshold_off;
}

}  // namespace

std::map<std::string, Bias> read_biases(JsonObject o, const std::map<std::string, Range>& values) {
  o.text("source");
  std::map<std::string, Bias> out;
  const auto key_of = [&](JsonObject& entry, const char* key) {
    const std::string value = entry.text(key);
    if (!values.contains(value)) entry.fail(key, value, "a key of values");
    return value;
  };
  for (JsonObject& entry : o.objects("offsets")) {
    Bias bias;
    const std::string name = entry.text("name");
    for (auto& [key, range] : {std::pair("allowed", &bias.allowed), std::pair("recommended", &bias.recommended)}) {
      const std::vector<double> ends = entry.numbers(key);
      if (ends.size() != 2 || ends[0] >= ends[1]) entry.fail(key, "no range", "[min, max]");
      *range = {ends[0], ends[1]};
    }
    if (entry.has("sets")) {
      bias.sets = entry.one_of("sets", {"contrast_threshold_on", "contrast_threshold_off"});
      bias.offset = entry.numbers("offset", bias.allowed);
      bias.factor = entry.numbers("factor", {0.01, 100});
      if (bias.offset.size() < 2 || bias.offset.size() != bias.factor.size() || !std::ranges::is_sorted(bias.offset))
        entry.fail("offset", fmt::format("{} for {} factors", bias.offset.size(), bias.factor.size()),
                   "as many, rising, at least 2");
      bias.doubtful_above = entry.maybe_number("doubtful_above", bias.allowed);
    } else if (entry.has("instead")) {
      bias.instead = key_of(entry, "instead");
    }
    entry.done();
    out[name] = std::move(bias);
  }
  o.done();
  return out;
}

void apply_biases(Chip& chip, const BiasSettings& biases, const std::vector<std::string>& overrides) {
  for (const auto& [name, offset] : biases) {
    if (chip.biases.empty()) throw wrong(name, fmt::format("no effect of a bias is published for {}", chip.name));
    const auto known = chip.biases.find(name);
    if (known == chip.biases.end()) {
      std::vector<std::string> names;
      for (const auto& [one, bias] : chip.biases) names.push_back(one);
      throw wrong(name, fmt::format("is unknown; {} has {}", chip.name, fmt::join(names, ", ")));
    }
    const Bias& bias = known->second;
    if (!(offset >= bias.allowed.min && offset <= bias.allowed.max))
      throw wrong(name, fmt::format("got {}, wanted an offset to the factory setting in [{}, {}]", offset,
                                    bias.allowed.min, bias.allowed.max));
    if (offset == 0) continue;  // the factory setting
    if (bias.sets.empty())
      throw wrong(name,
                  bias.instead.empty()
                      ? std::string("its effect is not published, and no value of the chip stands for it; set it to 0")
                      : fmt::format("its effect is not published; give --set {}=VALUE instead", bias.instead));
    if (!(offset >= bias.offset.front() && offset <= bias.offset.back()))
      throw wrong(name, fmt::format("got {}, wanted an offset in [{}, {}], where its effect was measured", offset,
                                    bias.offset.front(), bias.offset.back()));
    for (const std::string& text : overrides)
      if (text.starts_with(bias.sets + "="))
        throw wrong(name, fmt::format("sets {}, which --set also sets; give one of them", bias.sets));
    double& value = *threshold_of(chip, bias.sets);
    value *= factor_at(bias, offset);
    chip.set_biases[name] = offset;
    if (bias.doubtful_above && offset > *bias.doubtful_above)
      chip.warnings.push_back(
          fmt::format("bias {}: {} lies where the measured threshold falls again (above {}); the effect is doubtful",
                      name, offset, *bias.doubtful_above));
    if (!(offset >= bias.recommended.min && offset <= bias.recommended.max))
      chip.warnings.push_back(fmt::format("bias {}: {} is outside the recommended range, {} to {}", name, offset,
                                          bias.recommended.min, bias.recommended.max));
  }
}

BiasSettings biases_from(const std::string& text) {
  BiasSettings out;
  std::istringstream parts(text);
  for (std::string part; std::getline(parts, part, ',');) {
    const auto equals = part.find('=');
    const auto value = equals == std::string::npos ? std::nullopt : number_from<double>(part.substr(equals + 1));
    if (!value) throw wrong(part, "wanted NAME=OFFSET");
    add(out, part.substr(0, equals), *value);
  }
  return out;
}

BiasSettings read_bias_file(const std::filesystem::path& path, std::vector<std::string>& ignored) {
  BiasSettings out;
  if (lower(path.extension().string()) == ".json") {
    const Json json = parse_json_file(path);
    const auto state = json.is_object() ? json.find("ll_biases_state") : json.end();
    if (state == json.end())
      throw bad_input(path.string(), "ll_biases_state", "nothing", "camera settings with biases");
    JsonObject biases(*state, path.string(), "ll_biases_state");
    for (JsonObject& bias : biases.objects("bias")) add(out, bias.text("name"), bias.number("value"));
    for (const auto& [key, part] : json.items())
      if (part.is_object() && part.contains("enabled") && part["enabled"] == true) ignored.push_back(key);
    return out;
  }
  std::istringstream file(read_text(path, 1 << 20));
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    if (const auto first = line.find_first_not_of(" \t\r"); first == std::string::npos || line[first] == '%') continue;
    std::istringstream words(line);
    std::string value, percent, name;
    words >> value >> percent >> name;
    const auto known = number_from<double>(value);
    if (!known || percent != "%" || !plain_name(name).size())
      throw bad_input(path.string(), fmt::format("line {}", number), line.substr(0, 60), "VALUE % NAME");
    add(out, name, *known);
  }
  return out;
}

}  // namespace pecs::sensor
