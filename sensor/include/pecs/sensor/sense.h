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
#include "pecs/sensor/stages.h"
#include "pecs/sensor/timeline.h"
#include "pecs/strict_json.h"

namespace pecs::sensor {

struct SenseOptions {
  std::filesystem::path stack, output;
  std::optional<std::string> format;  // of the output; default: from its name
  std::string chip = "imx636";
  std::vector<std::string> overrides;  // "key=value"
  BiasSettings biases;
  std::optional<std::filesystem::path> bias_file;
  bool no_noise = false;  // photon noise, leak, background and mismatch off
  std::uint64_t seed = 1;
  int threads = 0;   // 0: all
  FrameTimes times;  // of frames that have none
  PhotocurrentOptions light;
  int monte_carlo_bands = 0;                    // > 0: number of drawn bands; 0: the sum over all bands
  std::shared_ptr<FrameSource> source;          // instead of `stack`
  std::string preset;                           // that apply_preset() applied, for the record
  ModelChoice model;                            // white_fa 0: the 99.5 % quantile of the first frame
  bool ideal_readout = false;                   // instead of the chip's (readout.h)
  std::optional<std::filesystem::path> labels;  // NPY, uint8: each event's Cause
  // Frames that the chip also takes: a new folder (frame_folder.h), or the output itself, if it holds
  // them.
  std::optional<std::filesystem::path> frames;
  // Events that come from the renderer's noise are estimated, with this factor on the stack's noise; 0: they are not.
  double render_noise = 1;
  StageOptions stages;
  std::optional<std::filesystem::path> dropped;  // NPY of the events that a stage after the readout dropped
  Window window;                                 // of the output
  bool motion = true;                            // warp light between frames along the source's motion, if it has any
  bool quiet = false;
  // Called with the events that are written, none where there are none, their times from the window's start. False ends
  // the output there.
  std::function<bool(std::span<const events::Event>)> watch;
  // Called with the completed share of the work, 0 to 1. False: sense() throws interrupted.
  std::function<bool(double)> progress;
};

// All that a run writes, for check_outputs().
std::vector<std::filesystem::path> outputs_of(const SenseOptions& options);

// The chip of a run, with its overrides, biases and noise. frames_option: the name of the option for its frames.
Chip chip_of(const SenseOptions& options, bool takes_frames, const std::string& frames_option);

struct SenseReport {
  Json config;   // resolved
  Json results;  // counts, rates, light
};

// Memory does not grow with the length of a stack. For a loop whose frames do not fit into kLoopBytes it grows with the
// number of events. Throws pecs::Error; the output does not exist then.
SenseReport sense(const SenseOptions& options);

}  // namespace pecs::sensor
