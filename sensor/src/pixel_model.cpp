#include "pecs/sensor/pixel_model.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "models/grey_model.h"
#include "models/pecs/pixels.h"
#include "pecs/error.h"

namespace pecs::sensor {
namespace {

class PecsModel : public PixelModel {
 public:
  PecsModel(const ModelSetup& s, double gain_fa, bool causes)
      : pixels_(s.chip, s.width, s.height, s.seed, gain_fa, causes) {}
  void advance(const FrameBatch& batch, EventSorter& order) override {
    for_tiles(pixels_.pixels(), order, [&](std::size_t first, std::size_t end, EventSlots& events) {
      pixels_.advance(batch, static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(end - first), events);
    });
  }

 private:
  PecsPixels pixels_;
};

constexpr ModelEntry kPecs{"pecs", "docs/sensor.md", {}, nullptr};
const ModelEntry* const kModels[] = {&kPecs, &kEsim, &kV2e, &kVoltmeter, &kIcns};

const ModelEntry& entry(const std::string& name) {
  for (const ModelEntry* m : kModels)
    if (m->name == name) return *m;
  throw Error(ExitCode::usage, fmt::format("--model: got {}, wanted one of {}", name, fmt::join(model_names(), ", ")));
}

// Defaults, and what was chosen instead.
std::map<std::string, double> resolved(const ModelEntry& model, const std::map<std::string, double>& chosen) {
  std::map<std::string, double> out;
  for (const ModelParameter& p : model.parameters) out[p.key] = p.value;
  for (const auto& [key, value] : chosen) {
    const auto known = std::ranges::find_if(model.parameters, [&](const auto& p) { return key == p.key; });
    if (known == model.parameters.end()) {
      std::vector<std::string> keys;
      for (const ModelParameter& p : model.parameters) keys.emplace_back(p.key);
      throw Error(ExitCode::usage, fmt::format("--param {}: got an unknown key, wanted for {}: {}", key, model.name,
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
  for (const ModelEntry* m : kModels) names.emplace_back(m->name);
  return names;
}

std::span<const ModelParameter> model_parameters(const std::string& model) { return entry(model).parameters; }
const char* model_source(const std::string& model) { return entry(model).source; }

std::unique_ptr<PixelModel> open_model(const ModelChoice& choice, const Chip& chip, int width, int height,
                                       std::uint64_t seed, double gain_fa, bool causes) {
  const ModelEntry& model = entry(choice.name);
  check_size(width, height);
  const double white_fa = choice.white_fa > 0 ? choice.white_fa : gain_fa;
  const ModelSetup setup{chip, width, height, seed, 255 * gain_fa / white_fa, resolved(model, choice.parameters)};
  if (!model.make) return std::make_unique<PecsModel>(setup, gain_fa, causes);
  if (causes) throw Error(ExitCode::usage, fmt::format("--labels: got model {}, wanted pecs", choice.name));
  return model.make(setup);
}

Json model_to_json(const ModelChoice& choice) {
  const ModelEntry& model = entry(choice.name);
  Json out = {{"name", choice.name}, {"parameters", Json::object()}};
  for (const auto& [key, value] : resolved(model, choice.parameters)) out["parameters"][key] = value;
  if (choice.white_fa > 0) out["white_a"] = choice.white_fa * 1e-15;
  return out;
}

}  // namespace pecs::sensor
