#pragma once
// Compares two recordings of one scene: distances with their noise floor, rates, polarity balance. Meaning and limits
// of each measure: docs/reference/metrics.md.
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "pecs/events/format.h"
#include "pecs/events/recording.h"
#include "pecs/metrics/delays.h"
#include "pecs/metrics/distances.h"
#include "pecs/metrics/realism.h"
#include "pecs/strict_json.h"

namespace pecs::metrics {

struct CompareOptions {
  Normalisation normalisation = Normalisation::shared;
  std::optional<std::int64_t> window_us = {};  // events from the origin to this time after it; empty: all
  bool common_origin = false;                  // the origin is t = 0 of both; otherwise each stream's first event
  bool split_half = true;                      // compute the noise floor
  bool realism = false;                        // train classifiers to tell the streams apart
  std::uint64_t seed = 1;                      // of the split into halves, and of realism
  int rate_bins = 100;                         // of the rate curves
  std::optional<TurningDisk> disk =
      {};  // in the real recording, with its clock: also compares the delays behind its edges
};

struct StreamSummary {
  std::size_t events = 0;
  std::int64_t t_first_us = 0, t_last_us = 0;  // of the events that are compared, clock of the file
  double rate_hz = 0;                          // events per second, from the origin to the last event in the window
  double on_fraction = 0;
  std::optional<double> interval_median_us;  // between consecutive events of a pixel
  std::vector<double> on_hz, off_hz;         // per bin of the rate curves
};

struct Comparison {
  CompareOptions options;
  int width = 0, height = 0;   // pixels
  std::int64_t window_us = 0;  // the common window
  std::int64_t curve_us = 0;   // length of the rate curves: to the last event of either stream
  Distances distance;          // index 0: real to simulated
  std::optional<Distances>
      floor;  // noise floor: between random halves of the real stream; empty for very few events or without split_half
  StreamSummary real, sim;
  std::optional<double> rate_correlation, on_correlation, off_correlation;  // Pearson, over bins; empty for flat curves
  Interval chamfer_interval, gaussian_interval;  // 95 %, bootstrap over 20 equal parts of the time
  std::optional<double> map_correlation, on_map_correlation, off_map_correlation;  // Pearson, over blocks of width/40
  std::optional<double> interval_distance_decades;  // earth mover's distance of log10 of the inter-event intervals
  std::optional<DelayComparison> delays;
  std::optional<Realism> realism;
  std::vector<std::string> warnings;
};

// `real_name` and `sim_name` are for errors. Throws bad_input when a stream has no events in the window, or the
// sensors differ in size under the shared normalisation or for delays, or the disk's time is not one of `real`.
Comparison compare(events::Stream real, const std::string& real_name, events::Stream sim, const std::string& sim_name,
                   const CompareOptions& options);

// Counts and rates of one recording.
StreamSummary summary_of(const events::Recording& recording, int rate_bins = 100);

Json to_json(const Comparison& comparison);

}  // namespace pecs::metrics
