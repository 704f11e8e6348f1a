#include "pecs/metrics/distances.h"

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "neighbours.h"
#include "pecs/error.h"

namespace pecs::metrics {
namespace {

using events::Event;

constexpr double kSpaceUnits = 100, kPolarityUnits = 100, kTimeUnits = 1000;  // alpha of Eq. 16
constexpr double kEpsilon = 1e-6;                                             // epsilon of Eq. 16
constexpr std::size_t kChunk = 256;                                           // groups of points

struct Limits {
  std::int64_t low = std::numeric_limits<std::int64_t>::max(), high = std::numeric_limits<std::int64_t>::min();
  void take(std::int64_t v) { low = std::min(low, v), high = std::max(high, v); }
  double span() const { return static_cast<double>(high - low) + kEpsilon; }
};

struct StreamLimits {
  Limits x, y, p, t;
};

StreamLimits limits_of(std::span<const Event> events) {
  StreamLimits limits;
  for (const Event& e : events) limits.x.take(e.x), limits.y.take(e.y), limits.p.take(e.p), limits.t.take(e.t_us);
  return limits;
}

// Eq. 16.
float scaled(std::int64_t value, const Limits& limits, double units) {
  return static_cast<float>(static_cast<double>(value - limits.low) / limits.span() * units);
}

// Eq. 16 as in the authors' program: the product is computed in the column's integer type.
template <class Column>
float truncated(std::int64_t value, const Limits& limits, int units) {
  const Column product = static_cast<Column>(static_cast<Column>(value - limits.low) * units);
  return static_cast<float>(std::trunc(static_cast<double>(product) / limits.span()));
}

struct Cloud {
  std::array<Neighbours, 2> groups;        // OFF, ON: x, y, t of the points
  std::array<float, 2> polarity = {0, 0};  // their coordinate
};

Cloud cloud_of(std::span<const Event> events, const MetricOptions& options) {
  StreamLimits limits;
  if (options.normalisation == Normalisation::shared) {
    limits = {{0, options.width - 1}, {0, options.height - 1}, {0, 1}, {0, options.window_us}};
  } else {
    limits = limits_of(events);
  }

  Cloud cloud;
  const bool integers = options.normalisation == Normalisation::paper;
  for (int p = 0; p < 2; ++p) {
    const auto clamped = std::clamp<std::int64_t>(p, limits.p.low, limits.p.high);
    cloud.polarity[p] = integers ? truncated<std::uint8_t>(clamped, limits.p, static_cast<int>(kPolarityUnits))
                                 : scaled(clamped, limits.p, kPolarityUnits);
  }
  for (const Event& e : events) {
    const Point point = integers ? Point{truncated<std::uint16_t>(e.x, limits.x, static_cast<int>(kSpaceUnits)),
                                         truncated<std::uint16_t>(e.y, limits.y, static_cast<int>(kSpaceUnits)),
                                         truncated<std::int64_t>(e.t_us, limits.t, static_cast<int>(kTimeUnits))}
                                 : Point{scaled(e.x, limits.x, kSpaceUnits), scaled(e.y, limits.y, kSpaceUnits),
                                         scaled(e.t_us, limits.t, kTimeUnits)};
    cloud.groups[e.p].add(point);
  }
  return cloud;
}

void add(BlockSums& to, const BlockSums& more) {
  for (int k = 0; k < kTimeBlocks; ++k)
    to.distance[k] += more.distance[k], to.kernel[k] += more.kernel[k], to.count[k] += more.count[k];
}

// Sums of d (Eq. 13) and g(d) (Eq. 15) over the points of one polarity of `a`, each to its nearest point of `b`.
BlockSums one_way(const Neighbours& from, float polarity, const Cloud& b, double sigma) {
  const auto gap2 = [&](int p) { return (polarity - b.polarity[p]) * (polarity - b.polarity[p]); };
  int first = gap2(0) <= gap2(1) ? 0 : 1;
  if (b.groups[first].empty()) first = 1 - first;
  const int second = 1 - first;

  const auto groups = from.groups();
  std::vector<BlockSums> chunks((groups.size() + kChunk - 1) / kChunk);
  tbb::parallel_for(std::size_t{0}, chunks.size(), [&](std::size_t chunk) {
    const std::size_t end = std::min(groups.size(), (chunk + 1) * kChunk);
    for (std::size_t i = chunk * kChunk; i < end; ++i) {
      std::array<float, kTogether> d2, rest;
      d2.fill(std::numeric_limits<float>::infinity());
      b.groups[first].nearest(groups[i], d2);
      for (std::size_t k = 0; k < kTogether; ++k) rest[k] = (d2[k] += gap2(first)) - gap2(second);
      if (!b.groups[second].empty() && std::ranges::any_of(rest, [](float r) { return r > 0; })) {
        std::array<float, kTogether> found = rest;
        b.groups[second].nearest(groups[i], found);
        for (std::size_t k = 0; k < kTogether; ++k)
          if (found[k] < rest[k]) d2[k] = found[k] + gap2(second);
      }
      for (std::size_t k = 0; k < groups[i].count; ++k) {
        const double part = groups[i].at[2][k] / kTimeUnits;
        const int block = std::clamp(static_cast<int>(part * kTimeBlocks), 0, kTimeBlocks - 1);
        chunks[chunk].distance[block] += std::sqrt(static_cast<double>(d2[k]));
        chunks[chunk].kernel[block] += -std::expm1(-static_cast<double>(d2[k]) / sigma);
        chunks[chunk].count[block] += 1;
      }
    }
  });

  // Sum in order, so that the result does not depend on the threads.
  BlockSums sums;
  for (const BlockSums& c : chunks) add(sums, c);
  return sums;
}

}  // namespace

Normalisation normalisation_from(const std::string& name) {
  for (const auto n : {Normalisation::shared, Normalisation::eq16, Normalisation::paper})
    if (name == name_of(n)) return n;
  throw Error(ExitCode::usage, fmt::format("normalisation: got '{}', wanted shared, eq16 or paper", name));
}

const char* name_of(Normalisation normalisation) {
  switch (normalisation) {
    case Normalisation::shared:
      return "shared";
    case Normalisation::eq16:
      return "eq16";
    case Normalisation::paper:
      return "paper";
  }
  return "";
}

Distances distances(std::span<const Event> a, std::span<const Event> b, const MetricOptions& options) {
  // Reject empty streams and incomplete options.
  if (a.empty() || b.empty())
    throw Error(ExitCode::bad_input,
                fmt::format("distance: got {} and {} events, wanted at least 1 in each stream", a.size(), b.size()));
  if (options.normalisation == Normalisation::shared &&
      (options.width < 1 || options.height < 1 || options.window_us < 1))
    throw Error(ExitCode::usage, "distance: shared normalisation needs the sensor's size and the window");

  // Build point clouds and trees for two streams and two polarities.
  std::array<Cloud, 2> clouds;
  tbb::parallel_invoke([&] { clouds[0] = cloud_of(a, options); }, [&] { clouds[1] = cloud_of(b, options); });
  tbb::parallel_for(0, 4, [&](int i) { clouds[i / 2].groups[i % 2].build(); });

  // Eq. 12 and 14.
  Distances result;
  const std::array<double, 2> counts = {static_cast<double>(a.size()), static_cast<double>(b.size())};
  for (int way = 0; way < 2; ++way) {
    BlockSums& blocks = result.blocks[way];
    for (int p = 0; p < 2; ++p)
      add(blocks, one_way(clouds[way].groups[p], clouds[way].polarity[p], clouds[1 - way], options.sigma));
    const auto total = [](const auto& parts) { return std::accumulate(parts.begin(), parts.end(), 0.0); };
    result.chamfer_parts[way] = total(blocks.distance) / counts[way];
    result.gaussian_parts[way] = total(blocks.kernel) / counts[way];
  }
  return result;
}

}  // namespace pecs::metrics
