#pragma once
// How long after a turning disk's edges their events come: what tells pixel models apart when rates and maps do not.
//
// The delay of an event is the angle by which the last edge of its polarity (ON: brightening) is past the pixel, or up
// to 1/18 of the period (720 / sectors) ahead: an edge is blurred. The edges are the real disk's for both streams, so
// that a simulation out of step shows it.
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
// From what `pecs align detect --json` prints. Throws bad_input when it has no rim.
TurningDisk turning_disk_from(JsonObject detected);

struct Delays {
  using ByPolarity = std::array<std::vector<double>, 2>;  // index 0: OFF
  ByPolarity histogram;              // events per pixel and passing edge, per bin; from -1/18 to 5/9 of the period
  std::array<double, 2> per_edge{};  // their sums
  std::optional<std::array<double, 3>> quantiles_deg[2];  // 10, 50, 90 % of the histogram
  // Standard deviation of an ON event's delay plus that of the OFF event that follows it in the pixel, within regions.
  // Each event resets the pixel, so that a late one shortens the next.
  std::optional<double> pair_sd_deg;
  std::vector<double> region_events;  // in the histograms, by region
};

// Parts of the disk: 24 around, counter-clockwise from the left, times 4 along the radius, from 0.2 to 0.98 of the
// rim's (nearer to the centre edges are slow). A region's index: around * 4 + along.
inline constexpr int kRegionsAround = 24, kRegionsAlong = 4;
inline constexpr double kInnerRadius = 0.2, kOuterRadius = 0.98;

// One recording's, with what it takes to predict the same numbers from a model of the pixel.
struct MeasuredDelays {
  TurningDisk disk;
  double first_deg = 0, bin_deg = 0;  // of the histograms: where they begin, width of a bin
  Delays delays;
  std::array<std::vector<std::vector<double>>, 2> passes;  // [OFF or ON][region][bin]: pixels times passing edges
};

struct DelayComparison {
  TurningDisk disk;                   // time_us: from the window's origin
  double first_deg = 0, bin_deg = 0;  // of the histograms: where they begin, width of a bin
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
