#pragma once
// The options of `pecs sense` as JSON, as C and Python give them: its long options with '_' for '-', those that repeat
// KEY=VALUE as an object of numbers.
#include "pecs/sensor/sense.h"

namespace pecs::sensor {

// "chip", "set", "no_noise", "seed", "threads", "model", "param", "readout": what the sensor is, whatever it looks at.
void read_sensor_options(JsonObject& object, SenseOptions& options);

// "fnumber", "gain", "photocurrent_a".
PhotocurrentOptions read_photocurrent_options(JsonObject& object);

// "key=value" of {"key": value, ...}, for load_chip.
std::vector<std::string> overrides_from(const Json& values);

// All of them; an unknown key is refused. Without stack and output.
SenseOptions sense_options(JsonObject object);

}  // namespace pecs::sensor
