#include "pecs/metrics/delays.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

#include "pecs/error.h"

namespace pecs::metrics {
namespace {

using events::Event;

constexpr double kDegree = std::numbers::pi / 180;
constexpr int kBins = 90, kBefore = 5,
              kShown = 55;  // of a period; before the edge; of the histogram: later is the next edge's
constexpr double kInner = 0.2, kOuter = 0.98;  // radii that count: near the centre edges are slow
constexpr int kAround = 24, kAlong = 4;        // regions
constexpr int kFine = 8;                       // parts of a bin, for the exposures
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

class Frame {  // that turns with the disk
 public:
  explicit Frame(const TurningDisk& d) : d_(d), period_deg_(720.0 / d.sectors) {}
  double period_deg() const { return period_deg_; }
  double bin(double delay_deg) const { return std::max(0.0, delay_deg / period_deg_ * kBins + kBefore); }

  // How far the edge of polarity p is past a pixel. Empty outside the ring.
  std::optional<double> delay_deg(int x, int y, double t_us, int p) const {
    const double dx = x + 0.5 - d_.centre_x, dy = d_.centre_y - (y + 0.5), r = std::hypot(dx, dy);
    if (r < kInner * d_.radius_px || r >= kOuter * d_.radius_px) return {};
    const double edge = (p ? d_.on_edge_deg : d_.off_edge_deg) + d_.speed_deg_s * 1e-6 * (t_us - d_.time_us);
    const double past = (edge - std::atan2(dy, dx) / kDegree) * (d_.speed_deg_s < 0 ? -1 : 1);
    return past - period_deg_ * std::floor(past / period_deg_ + static_cast<double>(kBefore) / kBins);
  }
  int region(int x, int y) const {
    const double dx = x + 0.5 - d_.centre_x, dy = d_.centre_y - (y + 0.5);
    const double around = std::atan2(dy, dx) / (2 * std::numbers::pi) + 0.5,
                 along = (std::hypot(dx, dy) / d_.radius_px - kInner) / (kOuter - kInner);
    return std::min(kAround - 1, static_cast<int>(around * kAround)) * kAlong +
           std::min(kAlong - 1, static_cast<int>(along * kAlong));
  }

 private:
  TurningDisk d_;
  double period_deg_;
};

// Pixels times the part of each bin of delay that an edge of polarity p goes through over them.
std::vector<double> exposures(const Frame& frame, double turned_deg, int width, int height, int p) {
  constexpr int kSteps = kBins * kFine;
  std::vector<double> start(kSteps), out(kBins);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      if (const auto d = frame.delay_deg(x, y, 0, p))
        start[std::min<std::size_t>(kSteps - 1, static_cast<std::size_t>(frame.bin(*d) * kFine))] += 1;
  const auto steps = std::llround(turned_deg / frame.period_deg() * kSteps);
  const double whole = static_cast<double>(steps / kSteps) * std::accumulate(start.begin(), start.end(), 0.0) / kFine;
  for (int i = 0; i < kSteps; ++i) {
    out[static_cast<std::size_t>(i / kFine)] += whole;
    for (int k = 0; k < steps % kSteps; ++k)
      out[static_cast<std::size_t>((i + k) % kSteps / kFine)] += start[i] / kFine;
  }
  return out;
}

Delays measure(std::span<const Event> events, const Frame& frame, int width, int height, double bin_deg,
               const std::array<std::vector<double>, 2>& seen) {
  Delays m;
  for (auto& h : m.histogram) h.resize(kShown);
  std::vector<double> on_before(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), kNone);
  std::vector<std::array<double, 3>> pairs(kAround * kAlong);  // count, sum, squares
  for (const Event& e : events) {
    const auto delay = frame.delay_deg(e.x, e.y, static_cast<double>(e.t_us), e.p);
    if (!delay) continue;
    const auto bin = static_cast<std::size_t>(frame.bin(*delay));
    const bool counts = bin < kShown;
    if (counts && seen[e.p][bin] > 0) m.histogram[e.p][bin] += 1 / seen[e.p][bin];

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
  const Frame frame(disk);
  c.bin_deg = frame.period_deg() / kBins;
  c.first_deg = -kBefore * c.bin_deg;
  const double turned_deg = std::abs(disk.speed_deg_s) * 1e-6 * static_cast<double>(end_us);
  const std::array seen = {exposures(frame, turned_deg, width, height, 0),
                           exposures(frame, turned_deg, width, height, 1)};
  c.real = measure(real, frame, width, height, c.bin_deg, seen);
  c.sim = measure(sim, frame, width, height, c.bin_deg, seen);
  for (std::size_t p = 0; p < 2; ++p) {
    if (c.real.per_edge[p] <= 0 || c.sim.per_edge[p] <= 0) continue;
    double common = 0, ahead = 0, moved = 0;
    for (std::size_t i = 0; i < kShown; ++i) {
      const double a = c.real.histogram[p][i] / c.real.per_edge[p], b = c.sim.histogram[p][i] / c.sim.per_edge[p];
      common += std::min(a, b);
      ahead += a - b;
      moved += std::abs(ahead) * c.bin_deg;
    }
    c.overlap[p] = common, c.earth_mover_deg[p] = moved;
  }
  return c;
}

Json to_json(const DelayComparison& c) {
  const auto or_null = [](const auto& value) { return value ? Json(*value) : Json(nullptr); };
  std::vector<double> edges;
  for (int i = 0; i <= kShown; ++i) edges.push_back(c.first_deg + i * c.bin_deg);
  const TurningDisk& d = c.disk;
  Json json = {{"disk",
                {{"centre_x", d.centre_x},
                 {"centre_y", d.centre_y},
                 {"radius_px", d.radius_px},
                 {"speed_deg_s", d.speed_deg_s},
                 {"sectors", d.sectors},
                 {"on_edge_deg", d.on_edge_deg},
                 {"off_edge_deg", d.off_edge_deg},
                 {"time_us", d.time_us}}},
               {"bin_edges_deg", edges},
               {"us_per_deg", 1e6 / std::abs(d.speed_deg_s)},
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

}  // namespace pecs::metrics
