#pragma once
// Would a classifier tell a simulation from a recording? Logistic regressions on features of patches (32x32 pixels,
// 10 ms), trained on one half of time and sensor and judged on the other; docs/reference/metrics.md defines the cues.
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "pecs/events/format.h"
#include "pecs/metrics/distances.h"
#include "pecs/strict_json.h"

namespace pecs::metrics {

// Area under the curve: the probability that a patch of the simulation gets the higher score; 0.5 is a coin.
struct Auc {
  double value = 0.5;
  Interval interval;  // 95 %, bootstrap over blocks of the sensor
};

// One group of features alone, among patches of equal numbers of events (except for the group "rate").
struct Cue {
  std::string name, quantity, values;  // what was measured, and what of the chip or the scene changes it
  Auc auc;
  double real = 0, sim = 0;  // means of the quantity
};

struct Realism {
  Auc all;                   // by all features
  std::optional<Auc> floor;  // the recording against itself, a label drawn for each block; empty for few patches
  std::vector<Cue> cues;
  std::vector<std::string> named;  // the strongest cues above the floor but rate, at most two, strongest first
  bool matched = true;  // patches of equal numbers of events exist: the cues but rate are compared among them
  std::size_t real_patches = 0, sim_patches = 0;
};

// The least that a stream must have in each quarter of time and sensor.
inline constexpr const char* kRealismRequires =
    "10 patches (32x32 pixels, 10 ms) with 20 events in each quarter of both files (half of time and sensor)";

// Streams in time order, times from the origin. Both are cut to the shorter one. Empty if a quarter of one has too few
// patches of at least 20 events.
std::optional<Realism> realism(const events::Stream& real, const events::Stream& sim, std::uint64_t seed);

// How well the streams are told apart, by what, and which values change it.
std::vector<std::string> sentences(const Realism& realism);

Json to_json(const Realism& realism);

}  // namespace pecs::metrics
