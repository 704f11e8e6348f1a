#include "pecs/sensor/pixel_model.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "models/entry.h"
#include "pecs/error.h"
#include "pecs/sensor/source.h"

namespace pecs::sensor {

extern const ModelEntry kModel_pecs, kModel_esim, kModel_v2e, kModel_voltmeter, kModel_icns;

namespace {

constexpr const ModelEntry* kModels[] = {&kModel_pecs, &kModel_esim, &kModel_v2e, &kModel_voltmeter, &kModel_icns};

const ModelEntry& entry(const std::string& name) {
  for (const ModelEntry* model : kModels)
    if (model->name == name) return *model;
  throw Error(ExitCode::usage,
              fmt::format("--model: got {}, wanted one of {}, or FILE.py:CLASS", name, fmt::join(model_names(), ", ")));
}

// Defaults, replaced by the values of `choice`.
std::map<std::string, double> resolved(const ModelChoice& choice) {
  if (choice.user) return choice.parameters;
  const ModelEntry& model = entry(choice.name);
  std::map<std::string, double> out;
  for (const ModelParameter& p : model.parameters) out[p.key] = p.value;
  for (const auto& [key, value] : choice.parameters) {
    const auto known = std::ranges::find_if(model.parameters, [&](const auto& p) { return key == p.key; });
    if (known == model.parameters.end()) {
      std::vector<std::string> keys;
      for (const ModelParameter& p : model.parameters) keys.emplace_back(p.key);
      throw Error(ExitCode::usage, fmt::format("--param {}: got an unknown key, wanted for {}: {}", key, choice.name,
                                               keys.empty() ? "none" : fmt::format("{}", fmt::join(keys, ", "))));
    }
    if (!(value >= known->min && value <= known->max))
      throw Error(ExitCode::usage, fmt::format("--param {}: got {}, wanted a number in [{}, {}] {}", key, value,
                                               known->min, known->max, known->unit));
    out[key] = value;
  }
  return out;
}

}  // namespace

std::vector<std::string> model_names() {
  std::vector<std::string> names;
  for (const ModelEntry* model : kModels) names.emplace_back(model->name);
  return names;
}

std::span<const ModelParameter> model_parameters(const std::string& model) { return entry(model).parameters; }
const char* model_source(const std::string& model) { return entry(model).source; }
ModelTraits model_traits(const ModelChoice& model) {
  if (!model.user) return entry(model.name).traits;
  return {.takes_light = model.user->takes_light,
          .tells_causes = model.user->tells_causes,
          .pixels_are_independent = false,
          .in_tiles = false};
}

std::unique_ptr<PixelModel> open_model(const ModelChoice& choice, const Chip& chip, int width, int height,
                                       std::uint64_t seed, double unit_fa, bool causes) {
  const ModelTraits traits = model_traits(choice);
  if (width < 1 || height < 1 || width > kMaxSide || height > kMaxSide)
    throw bad_input("frames", "size", fmt::format("{}x{}", width, height), fmt::format("1x1 to {0}x{0}", kMaxSide));
  if (causes && !traits.tells_causes) {
    std::vector<std::string> tell;
    for (const ModelEntry* m : kModels)
      if (m->traits.tells_causes) tell.emplace_back(m->name);
    throw Error(ExitCode::usage, fmt::format("--labels: got model {}, wanted {}", choice.name, fmt::join(tell, ", ")));
  }
  const double grey_per_unit = 255 * unit_fa / (choice.white_fa > 0 ? choice.white_fa : unit_fa);
  const ModelSetup setup{chip,
                         width,
                         height,
                         seed,
                         traits.takes_light ? unit_fa : grey_per_unit,
                         causes,
                         resolved(choice),
                         choice.random_phase,
                         choice.noise_seed.value_or(seed)};
  return choice.user ? make_user_model(setup, choice) : entry(choice.name).make(setup);
}

Json model_to_json(const ModelChoice& choice) {
  Json out = {{"name", choice.name}, {"parameters", Json::object()}};
  for (const auto& [key, value] : resolved(choice)) out["parameters"][key] = value;
  if (choice.white_fa > 0) out["white_a"] = choice.white_fa * 1e-15;
  return out;
}

}  // namespace pecs::sensor
