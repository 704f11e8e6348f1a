#pragma once
// The options of `pecs sense` as JSON, for C and Python: its long options with '_' for '-'; an option that takes
// KEY=VALUE is an object of numbers.
#include <limits>

#include "pecs/sensor/sense.h"

namespace pecs::sensor {

// Upper limit of start_us and duration_us: 24 h.
constexpr std::int64_t kLongestTime_us = 86'400'000'000;

// Largest seed: the largest integer that JSON readers of all languages hold.
constexpr std::uint64_t kLargestSeed = std::numeric_limits<std::int64_t>::max();

// Largest factor on the renderer's noise.
constexpr double kMostRenderNoise = 100;

// N for "mc:N" (Eq. 8-11), 1 to 999999; 0 for "all"; nothing for other texts.
std::optional<int> monte_carlo_bands(std::string_view text);

// A published setting of another simulator's model (sensor/presets/*.json): values of the chip and parameters of the
// model, with their source.
struct Preset {
  std::string name, description, source, model;
  Json set, param;  // {"key": number}
};

// `name`: of a file in sensor/presets, or a path (see find_data). Throws not_found, and bad_input for a bad file.
Preset load_preset(const std::string& name);
// All of sensor/presets, by name: [{"name", "description", "source", "model", "set", "param"}].
Json presets();

// Values of options.preset that the options do not set themselves. Without `readout_given` the readout is ideal, since
// other simulators have none. Throws usage if the model was given and is another one.
void apply_preset(SenseOptions& options, bool model_given, bool readout_given);

// Options of the sensor: "chip", "set", "bias", "bias_file", "no_noise", "seed", "threads", "preset", "model", "param",
// "readout", and those of the stages (stages.h).
void read_sensor_options(JsonObject& object, SenseOptions& options);

// "fnumber", "gain", "photocurrent_a".
PhotocurrentOptions read_photocurrent_options(JsonObject& object);

// Converts {"key": value, ...} to "key=value" texts for load_chip.
std::vector<std::string> overrides_from(const Json& values);

// All options but stack and output. An unknown key is an error.
SenseOptions sense_options(JsonObject object);

}  // namespace pecs::sensor
