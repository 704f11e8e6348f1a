#pragma once
// Delays of events behind the edges of a rotating disk, which distinguish pixel models of equal rates and maps.
//
// The delay of an event is the angle by which the last edge of its polarity (ON: brightening) has passed the pixel. It
// may be negative, down to 1/18 of the period (720 / sectors), because edges are blurred. Both streams use the edges of
// the real disk, so that a phase error of the simulation is visible.
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "pecs/events/event.h"
#include "pecs/strict_json.h"

namespace pecs::metrics {

// Angles as in disk.h: degrees, counter-clockwise on screen, at t = time_us.
struct TurningDisk {
  double centre_x = 0, centre_y = 0, radius_px = 0, speed_deg_s = 0, on_edge_deg = 0, off_edge_deg = 0, time_us = 0;
  int sectors = 0;
};
// From the output of `pecs align detect --json`. Throws bad_input when it has no rim.
TurningDisk turning_disk_from(JsonObject detected);

struct Delays {
  using ByPolarity = std::array<std::vector<double>, 2>;  // index 0: OFF
  ByPolarity histogram;              // events per pixel and passing edge in each bin; from -1/18 to 5/9 of the period
  std::array<double, 2> per_edge{};  // their sums
  std::optional<std::array<double, 3>> quantiles_deg[2];  // 10, 50, 90 % of the histogram
  // Standard deviation of the sum of an ON event's delay and that of the pixel's next OFF event, within regions. Each
  // event resets the pixel, so a late one shortens the delay of the next.
  std::optional<double> pair_sd_deg;
  std::vector<double> region_events;  // in the histograms, by region
};

// Regions of the disk: 24 in angle, counter-clockwise from the left, times 4 in radius, from 0.2 to 0.98 of the rim's
// (edges near the centre are slow). Index of a region: around * 4 + along.
inline constexpr int kRegionsAround = 24, kRegionsAlong = 4;
inline constexpr double kInnerRadius = 0.2, kOuterRadius = 0.98;

// Delays of one recording, with the exposures that a prediction from a pixel model requires.
struct MeasuredDelays {
  TurningDisk disk;
  double first_deg = 0, bin_deg = 0;  // of the histograms: start, width of a bin
  Delays delays;
  std::array<std::vector<std::vector<double>>, 2> passes;  // [OFF or ON][region][bin]: pixels times passing edges
};

struct DelayComparison {
  TurningDisk disk;                   // time_us: from the window's origin
  double first_deg = 0, bin_deg = 0;  // of the histograms: start, width of a bin
  Delays real, sim;
  std::array<std::optional<double>, 2> overlap;          // common area of the histograms, each of area 1
  std::array<std::optional<double>, 2> earth_mover_deg;  // between them (earth_mover.h)
};

// Events in time order, times from the window's origin, of sensors of width x height pixels; the window ends at end_us.
DelayComparison compare_delays(std::span<const events::Event> real, std::span<const events::Event> sim, int width,
                               int height, std::int64_t end_us, const TurningDisk& disk);

MeasuredDelays measure_delays(std::span<const events::Event> events, int width, int height, std::int64_t end_us,
                              const TurningDisk& disk);

Json to_json(const DelayComparison& delays);
Json to_json(const MeasuredDelays& measured);

}  // namespace pecs::metrics
