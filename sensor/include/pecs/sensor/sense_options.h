#pragma once
// The options of `pecs sense` as JSON, as C and Python give them: its long options with '_' for '-', those that repeat
// KEY=VALUE as an object of numbers.
#include <limits>

#include "pecs/sensor/sense.h"

namespace pecs::sensor {

// Upper limit of start_us and duration_us: 24 h.
constexpr std::int64_t kLongestTime_us = 86'400'000'000;

// Largest seed: the largest integer that JSON readers of all languages hold.
constexpr std::uint64_t kLargestSeed = std::numeric_limits<std::int64_t>::max();

// N of "mc:N" (Eq. 8-11), 1 to 999999; 0 of "all"; nothing of other texts.
std::optional<int> monte_carlo_bands(std::string_view text);

// "chip", "set", "no_noise", "seed", "threads", "model", "param", "readout": what the sensor is, whatever it looks at.
void read_sensor_options(JsonObject& object, SenseOptions& options);

// "fnumber", "gain", "photocurrent_a".
PhotocurrentOptions read_photocurrent_options(JsonObject& object);

// "key=value" of {"key": value, ...}, for load_chip.
std::vector<std::string> overrides_from(const Json& values);

// All of them; an unknown key is refused. Without stack and output.
SenseOptions sense_options(JsonObject object);

}  // namespace pecs::sensor
