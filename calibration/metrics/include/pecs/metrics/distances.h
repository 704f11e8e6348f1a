#pragma once
// Distances between two event streams as 4-D point clouds (x, y, p, t): Chamfer distance and Gaussian distance of the
// PECS paper, Eq. 12-16, with exact nearest neighbours. Meaning and limits: docs/reference/metrics.md.
#include <array>
#include <cstdint>
#include <span>
#include <string>

#include "pecs/events/event.h"

namespace pecs::metrics {

// Scaling of (x, y, p, t) to 0..100, 0..100, 0..100, 0..1000 (Eq. 16).
enum class Normalisation {
  shared,  // one scale for both streams: the sensor size and the common window
  eq16,    // Eq. 16 as printed: each stream by its own minimum and maximum, in floating point
  paper,   // the arithmetic behind the published tables: as eq16, but x and y are multiplied by 100 in uint16, which
           // overflows above 655, and every coordinate is truncated to an integer
};
Normalisation normalisation_from(const std::string& name);  // "shared", "eq16", "paper"; throws usage
const char* name_of(Normalisation normalisation);

struct MetricOptions {
  Normalisation normalisation = Normalisation::shared;
  int width = 0, height = 0;   // shared: sensor size, pixels
  std::int64_t window_us = 0;  // shared: t_us in [0, window_us] becomes 0..1000
  double sigma = 0.4;          // Eq. 15, used as exp(-d²/sigma): the published numbers do not square it
};

struct Interval {
  double low = 0, high = 0;
};

// Contributions to the distances by equal parts of the time, for bootstrap intervals.
inline constexpr int kTimeBlocks = 20;
struct BlockSums {
  std::array<double, kTimeBlocks> distance{}, kernel{}, count{};  // sums of d and g(d) (Eq. 13, 15), events
};

// Index 0: mean over the events of `a` of the distance to the nearest event of `b`; index 1: the other way round.
struct Distances {
  std::array<double, 2> chamfer_parts{};   // Eq. 12, normalised units
  std::array<double, 2> gaussian_parts{};  // Eq. 14, each 0..1
  std::array<BlockSums, 2> blocks{};
  double chamfer() const { return chamfer_parts[0] + chamfer_parts[1]; }
  double gaussian() const { return gaussian_parts[0] + gaussian_parts[1]; }
};

// Runs on all cores; the result does not depend on their number. Streams need no order. Throws bad_input when a stream
// is empty, and usage when `shared` lacks the sensor's size or the window.
Distances distances(std::span<const events::Event> a, std::span<const events::Event> b, const MetricOptions& options);

}  // namespace pecs::metrics
