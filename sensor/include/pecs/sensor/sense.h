#pragma once
// The whole sensor: a source of frames in, an event file out (docs/reference/sensor.md).
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "pecs/events/event.h"
#include "pecs/sensor/photocurrent.h"
#include "pecs/sensor/pixel_model.h"
#include "pecs/sensor/source.h"
#include "pecs/sensor/timeline.h"
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
  PhotocurrentOptions light;
  int monte_carlo_bands = 0;                    // > 0: so many bands, drawn, instead of the sum over all
  std::shared_ptr<FrameSource> source;          // instead of `stack`
  ModelChoice model;                            // white_fa 0: the brightest 0.5 % of the first frame are white
  bool ideal_readout = false;                   // else the chip's (readout.h)
  std::optional<std::filesystem::path> labels;  // NPY, uint8: each event's cause (0 signal, 1 leak, 2 noise, 3 hot)
  Window window;                                // of the output
  bool motion = true;                           // light between frames along the source's motion, if it has any
  bool quiet = false;
  // Sees the events as they are written, their times from the window's start. False: that is enough, the output ends
  // here.
  std::function<bool(std::span<const events::Event>)> watch;
  // Told the part of the work that is done, 0 to 1 (not of a live source). False: stop; sense() throws interrupted.
  std::function<bool(double)> progress;
};

struct SenseReport {
  Json config;   // resolved
  Json results;  // counts, rates, light
};

// Memory does not grow with the length of a stack. Of a loop whose frames do not fit into memory it grows with the
// number of events. Throws pecs::Error; then the output does not exist.
SenseReport sense(const SenseOptions& options);

}  // namespace pecs::sensor
