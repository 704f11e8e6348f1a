#pragma once
// The whole sensor: an EXR stack in, an event file out (docs/sensor.md).
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "pecs/sensor/photocurrent.h"
#include "pecs/sensor/pixel_model.h"
#include "pecs/sensor/source.h"
#include "pecs/strict_json.h"

namespace pecs::sensor {

struct SenseOptions {
  std::filesystem::path stack, output;
  std::optional<std::string> format;  // of the output; else from its name
  std::string chip = "imx636";
  std::vector<std::string> overrides;  // "key=value"
  bool no_noise = false;               // photon noise, leak, background and mismatch off
  std::uint64_t seed = 1;
  int threads = 0;   // 0: all
  FrameTimes times;  // for frames without times of their own
  LightOptions light;
  int monte_carlo_bands = 0;                    // > 0: so many bands, drawn (light.h), instead of the sum over all
  std::shared_ptr<const FrameSource> source;    // instead of `stack`
  ModelChoice model;                            // white_fa 0: the brightest 0.5 % of the first frame are white
  bool ideal_readout = false;                   // else the chip's (readout.h)
  std::optional<std::filesystem::path> labels;  // NPY, uint8: each event's cause (0 signal, 1 leak, 2 noise, 3 hot)
  int warmup_loops = 0;                         // of a periodic stack, before the output begins
  std::int64_t start_us = 0;                    // output begins this long after the warm-up
  std::optional<std::int64_t> duration_us;
  bool quiet = false;
  std::function<bool(double)> progress;  // the share done, now and then; false stops (Error: interrupted)
};

struct SenseReport {
  Json config;   // resolved
  Json results;  // counts, rates, light
};

// Memory does not grow with the length of a stack; of a looped one it grows with its number of events.
// Throws pecs::Error; then the output does not exist.
SenseReport sense(const SenseOptions& options);

}  // namespace pecs::sensor
