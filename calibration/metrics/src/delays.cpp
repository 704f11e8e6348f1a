#include "pecs/metrics/delays.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <numeric>

#include "pecs/error.h"
#include "pecs/metrics/earth_mover.h"

namespace pecs::metrics {
namespace {

using events::Event;

constexpr double kDegree = std::numbers::pi / 180;
constexpr int kBins = 90, kBefore = 5,
              kShown = 55;  // bins of a period; before the edge; of the histogram (later ones belong to the next edge)
constexpr int kRegions = kRegionsAround * kRegionsAlong;
constexpr int kFine = 8;  // parts of a bin, for the exposures
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

class RotatingFrame {  // rotates with the disk
 public:
  explicit RotatingFrame(const TurningDisk& d) : d_(d), period_deg_(720.0 / d.sectors) {}
  double period_deg() const { return period_deg_; }
  double bin(double delay_deg) const { return std::max(0.0, delay_deg / period_deg_ * kBins + kBefore); }

  // Angle by which the last edge of polarity p has passed a pixel. Empty outside the ring.
  std::optional<double> delay_deg(int x, int y, double t_us, int p) const {
    const double dx = x + 0.5 - d_.centre_x, dy = d_.centre_y - (y + 0.5), r = std::hypot(dx, dy);
    if (r < kInnerRadius * d_.radius_px || r >= kOuterRadius * d_.radius_px) return {};
    const double edge = (p ? d_.on_edge_deg : d_.off_edge_deg) + d_.speed_deg_s * 1e-6 * (t_us - d_.time_us);
    const double past = (edge - std::atan2(dy, dx) / kDegree) * (d_.speed_deg_s < 0 ? -1 : 1);
    return past - period_deg_ * std::floor(past / period_deg_ + static_cast<double>(kBefore) / kBins);
  }
  int region(int x, int y) const {
    const double dx = x + 0.5 - d_.centre_x, dy = d_.centre_y - (y + 0.5);
    const double around = std::atan2(dy, dx) / (2 * std::numbers::pi) + 0.5,
                 along = (std::hypot(dx, dy) / d_.radius_px - kInnerRadius) / (kOuterRadius - kInnerRadius);
    return std::min(kRegionsAround - 1, static_cast<int>(around * kRegionsAround)) * kRegionsAlong +
           std::min(kRegionsAlong - 1, static_cast<int>(along * kRegionsAlong));
  }

 private:
  TurningDisk d_;
  double period_deg_;
};

using Passes = std::vector<std::vector<double>>;

// [region][bin]: exposure of each bin of delay, in pixels times passing edges of polarity p.
Passes passes_of(const RotatingFrame& frame, double turned_deg, int width, int height, int p) {
  constexpr int kSteps = kBins * kFine;
  std::vector<std::vector<double>> start(kRegions, std::vector<double>(kSteps));
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      if (const auto d = frame.delay_deg(x, y, 0, p))
        start[static_cast<std::size_t>(frame.region(x, y))]
             [std::min<std::size_t>(kSteps - 1, static_cast<std::size_t>(frame.bin(*d) * kFine))] += 1;
  const auto steps = std::llround(turned_deg / frame.period_deg() * kSteps), periods = steps / kSteps;
  Passes out(kRegions, std::vector<double>(kBins));
  for (std::size_t r = 0; r < kRegions; ++r) {
    const double all = std::accumulate(start[r].begin(), start[r].end(), 0.0);
    const double whole = static_cast<double>(periods) * all / kFine;
    for (int i = 0; i < kSteps; ++i) {
      out[r][static_cast<std::size_t>(i / kFine)] += whole;
      for (int k = 0; k < steps % kSteps && start[r][i] > 0; ++k)
        out[r][static_cast<std::size_t>((i + k) % kSteps / kFine)] += start[r][i] / kFine;
    }
  }
  return out;
}

std::vector<double> summed(const Passes& passes) {
  std::vector<double> out(kBins);
  for (const auto& region : passes) std::transform(out.begin(), out.end(), region.begin(), out.begin(), std::plus<>());
  return out;
}

Delays measure(std::span<const Event> events, const RotatingFrame& frame, int width, int height, double bin_deg,
               const std::array<std::vector<double>, 2>& seen) {
  Delays m;
  for (auto& h : m.histogram) h.resize(kShown);
  m.region_events.resize(kRegions);
  std::vector<double> on_before(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), kNone);
  std::vector<std::array<double, 3>> pairs(kRegions);  // count, sum, squares
  for (const Event& e : events) {
    const auto delay = frame.delay_deg(e.x, e.y, static_cast<double>(e.t_us), e.p);
    if (!delay) continue;
    const auto bin = static_cast<std::size_t>(frame.bin(*delay));
    const bool counts = bin < kShown;
    if (counts && seen[e.p][bin] > 0) m.histogram[e.p][bin] += 1 / seen[e.p][bin];
    if (counts) m.region_events[static_cast<std::size_t>(frame.region(e.x, e.y))] += 1;

    double& before = on_before[static_cast<std::size_t>(e.y) * static_cast<std::size_t>(width) + e.x];
    if (!e.p && counts && !std::isnan(before)) {
      auto& [n, sum, squares] = pairs[static_cast<std::size_t>(frame.region(e.x, e.y))];
      const double both = before + *delay;
      n += 1, sum += both, squares += both * both;
    }
    before = e.p && counts ? *delay : kNone;
  }

  for (std::size_t p = 0; p < 2; ++p) {
    const auto& h = m.histogram[p];
    m.per_edge[p] = std::accumulate(h.begin(), h.end(), 0.0);
    if (m.per_edge[p] <= 0) continue;
    auto& q = m.quantiles_deg[p].emplace();
    for (std::size_t k = 0; k < 3; ++k) {
      double left = std::array{0.1, 0.5, 0.9}[k] * m.per_edge[p];
      std::size_t i = 0;
      while (i + 1 < kShown && left > h[i]) left -= h[i++];
      q[k] = (static_cast<double>(i) - kBefore + left / std::max(h[i], 1e-300)) * bin_deg;
    }
  }
  double n = 0, squares = 0;
  for (const auto& [count, sum, square] : pairs)
    if (count > 1) n += count - 1, squares += square - sum * sum / count;
  if (n > 0) m.pair_sd_deg = std::sqrt(std::max(0.0, squares) / n);
  return m;
}

}  // namespace

TurningDisk turning_disk_from(JsonObject detected) {
  const auto value = [&](const char* key) { return detected.object(key).number("value"); };
  TurningDisk d;
  d.centre_x = value("centre_x"), d.centre_y = value("centre_y");
  d.speed_deg_s = value("speed_deg_s");
  d.on_edge_deg = value("on_edge_deg"), d.off_edge_deg = value("off_edge_deg");
  d.time_us = detected.number("phase_time_us");
  d.sectors = static_cast<int>(detected.integer("sectors", 2, 1000));
  if (!detected.has("rim")) detected.fail("rim", "no rim", "a disk whose rim was found");
  JsonObject rim = detected.object("rim");
  d.radius_px = (rim.number("axis_a_px", {1, 1e6}) + rim.number("axis_b_px", {1, 1e6})) / 4;
  if (d.speed_deg_s == 0) detected.fail("speed_deg_s", "0", "a disk that turns");
  return d;
}

DelayComparison compare_delays(std::span<const Event> real, std::span<const Event> sim, int width, int height,
                               std::int64_t end_us, const TurningDisk& disk) {
  DelayComparison c;
  c.disk = disk;
  const RotatingFrame frame(disk);
  c.bin_deg = frame.period_deg() / kBins;
  c.first_deg = -kBefore * c.bin_deg;
  const double turned_deg = std::abs(disk.speed_deg_s) * 1e-6 * static_cast<double>(end_us);
  const std::array seen = {summed(passes_of(frame, turned_deg, width, height, 0)),
                           summed(passes_of(frame, turned_deg, width, height, 1))};
  c.real = measure(real, frame, width, height, c.bin_deg, seen);
  c.sim = measure(sim, frame, width, height, c.bin_deg, seen);
  for (std::size_t p = 0; p < 2; ++p) {
    if (c.real.per_edge[p] <= 0 || c.sim.per_edge[p] <= 0) continue;
    double common = 0;
    for (std::size_t i = 0; i < kShown; ++i)
      common += std::min(c.real.histogram[p][i] / c.real.per_edge[p], c.sim.histogram[p][i] / c.sim.per_edge[p]);
    c.overlap[p] = common;
    c.earth_mover_deg[p] = earth_mover(c.real.histogram[p], c.sim.histogram[p], c.bin_deg);
  }
  return c;
}

MeasuredDelays measure_delays(std::span<const Event> events, int width, int height, std::int64_t end_us,
                              const TurningDisk& disk) {
  MeasuredDelays m;
  m.disk = disk;
  const RotatingFrame frame(disk);
  m.bin_deg = frame.period_deg() / kBins, m.first_deg = -kBefore * m.bin_deg;
  const double turned_deg = std::abs(disk.speed_deg_s) * 1e-6 * static_cast<double>(end_us);
  std::array<std::vector<double>, 2> seen;
  for (int p = 0; p < 2; ++p) {
    m.passes[p] = passes_of(frame, turned_deg, width, height, p);
    seen[p] = summed(m.passes[p]);
  }
  m.delays = measure(events, frame, width, height, m.bin_deg, seen);
  for (auto& polarity : m.passes)
    for (auto& region : polarity) region.resize(kShown);
  return m;
}

namespace {

Json json_of(const TurningDisk& d) {
  return {{"centre_x", d.centre_x},         {"centre_y", d.centre_y}, {"radius_px", d.radius_px},
          {"speed_deg_s", d.speed_deg_s},   {"sectors", d.sectors},   {"on_edge_deg", d.on_edge_deg},
          {"off_edge_deg", d.off_edge_deg}, {"time_us", d.time_us}};
}

std::vector<double> bin_edges(double first_deg, double bin_deg) {
  std::vector<double> edges;
  for (int i = 0; i <= kShown; ++i) edges.push_back(first_deg + i * bin_deg);
  return edges;
}

}  // namespace

Json to_json(const DelayComparison& c) {
  Json json = {{"disk", json_of(c.disk)},
               {"bin_edges_deg", bin_edges(c.first_deg, c.bin_deg)},
               {"us_per_deg", 1e6 / std::abs(c.disk.speed_deg_s)},
               {"pair_sd_deg", {{"real", or_null(c.real.pair_sd_deg)}, {"sim", or_null(c.sim.pair_sd_deg)}}}};
  for (const std::size_t p : {1, 0})
    json[p ? "on" : "off"] = {
        {"overlap", or_null(c.overlap[p])},
        {"earth_mover_deg", or_null(c.earth_mover_deg[p])},
        {"events_per_edge", {{"real", c.real.per_edge[p]}, {"sim", c.sim.per_edge[p]}}},
        {"quantiles_deg", {{"real", or_null(c.real.quantiles_deg[p])}, {"sim", or_null(c.sim.quantiles_deg[p])}}},
        {"histogram", {{"real", c.real.histogram[p]}, {"sim", c.sim.histogram[p]}}}};
  return json;
}

Json to_json(const MeasuredDelays& m) {
  Json json = {{"disk", json_of(m.disk)},
               {"bin_edges_deg", bin_edges(m.first_deg, m.bin_deg)},
               {"us_per_deg", 1e6 / std::abs(m.disk.speed_deg_s)},
               {"pair_sd_deg", or_null(m.delays.pair_sd_deg)},
               {"regions",
                {{"around", kRegionsAround},
                 {"along", kRegionsAlong},
                 {"inner_px", kInnerRadius * m.disk.radius_px},
                 {"outer_px", kOuterRadius * m.disk.radius_px},
                 {"events", m.delays.region_events}}}};
  for (const std::size_t p : {1, 0})
    json[p ? "on" : "off"] = {{"events_per_edge", m.delays.per_edge[p]},
                              {"quantiles_deg", or_null(m.delays.quantiles_deg[p])},
                              {"histogram", m.delays.histogram[p]},
                              {"passes", m.passes[p]}};
  return json;
}

}  // namespace pecs::metrics
