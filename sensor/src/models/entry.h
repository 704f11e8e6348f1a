#pragma once
// Registry entry of a pixel model (pixel_model.h).
#include "pecs/sensor/pixel_model.h"

namespace pecs::sensor {

struct ModelSetup {
  const Chip& chip;
  int width, height;
  std::uint64_t seed;
  double per_unit;  // of a plane's value 1: photocurrent [fA], or grey value from 0 to 255
  bool causes;
  std::map<std::string, double> parameters;
  bool random_phase = false;
  std::uint64_t noise_seed = seed;
  std::size_t pixels() const { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }
  double at(const char* key) const { return parameters.at(key); }
};

struct ModelEntry {
  const char* name;
  const char* source;  // the paper
  std::span<const ModelParameter> parameters;
  ModelTraits traits;
  std::unique_ptr<PixelModel> (*make)(const ModelSetup&);
};

std::unique_ptr<PixelModel> make_user_model(const ModelSetup& setup, const ModelChoice& choice);

template <class Model>
std::unique_ptr<PixelModel> make_model(const ModelSetup& setup) {
  return std::make_unique<Model>(setup);
}

}  // namespace pecs::sensor
