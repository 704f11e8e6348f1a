#include "pecs/metrics/compare.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numeric>
#include <random>

#include "pecs/error.h"
#include "pecs/metrics/earth_mover.h"

namespace pecs::metrics {
namespace {

using events::Event;

struct Extent {
  std::int64_t first_us, last_us;
};

// Keeps the events of the window in file order, with times from its origin. Returns the first and last time of the
// file.
Extent keep_window(std::vector<Event>& events, const std::string& name, const CompareOptions& options) {
  const auto by_time = [](const Event& a, const Event& b) { return a.t_us < b.t_us; };
  if (events.empty()) throw bad_input(name, "", "0 events", "at least 1");
  const auto [first, last] = std::minmax_element(events.begin(), events.end(), by_time);
  const Extent extent{first->t_us, last->t_us};
  const std::int64_t origin = options.common_origin ? 0 : extent.first_us;

  for (Event& e : events) e.t_us -= origin;
  std::erase_if(events,
                [&](const Event& e) { return e.t_us < 0 || (options.window_us && e.t_us >= *options.window_us); });
  if (events.empty())
    throw bad_input(name, "window", "0 events",
                    options.window_us
                        ? fmt::format("at least 1 event in {} us from t = {} us", *options.window_us, origin)
                        : "at least 1 event at or after t = 0");
  return extent;
}

std::int64_t extent_us(const std::vector<Event>& events) {
  std::int64_t end = 0;
  for (const Event& e : events) end = std::max(end, e.t_us + 1);
  return end;
}

StreamSummary summary_of(const std::vector<Event>& events, std::int64_t origin_us, std::int64_t curve_us, int bins) {
  StreamSummary s;
  s.events = events.size();
  const auto [first, last] = std::ranges::minmax(events, {}, &Event::t_us);
  s.t_first_us = origin_us + first.t_us, s.t_last_us = origin_us + last.t_us;
  const double curve_s = static_cast<double>(curve_us) * 1e-6, n = static_cast<double>(events.size());
  s.rate_hz = n / (static_cast<double>(extent_us(events)) * 1e-6);

  s.on_hz.resize(static_cast<std::size_t>(bins)), s.off_hz.resize(static_cast<std::size_t>(bins));
  std::size_t on = 0;
  for (const Event& e : events) {
    on += e.p;
    const auto bin = static_cast<std::size_t>(std::min<std::int64_t>(e.t_us * bins / curve_us, bins - 1));
    (e.p ? s.on_hz : s.off_hz)[bin] += bins / curve_s;
  }
  s.on_fraction = static_cast<double>(on) / n;
  return s;
}

std::optional<double> correlation(const std::vector<double>& a, const std::vector<double>& b) {
  const auto mean = [](const auto& v) {
    return std::accumulate(v.begin(), v.end(), 0.0) / static_cast<double>(v.size());
  };
  const double mean_a = mean(a), mean_b = mean(b);
  double ab = 0, aa = 0, bb = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    ab += (a[i] - mean_a) * (b[i] - mean_b);
    aa += (a[i] - mean_a) * (a[i] - mean_a);
    bb += (b[i] - mean_b) * (b[i] - mean_b);
  }
  if (aa <= 0 || bb <= 0) return {};
  return ab / std::sqrt(aa * bb);
}

std::vector<double> sum(const std::vector<double>& a, const std::vector<double>& b) {
  std::vector<double> out(a.size());
  std::transform(a.begin(), a.end(), b.begin(), out.begin(), std::plus<>());
  return out;
}

// Events per block of the sensor, by polarity.
std::array<std::vector<double>, 2> maps_of(const std::vector<Event>& events, int width, int height) {
  const int size = std::max(1, width / 40), columns = (width + size - 1) / size, rows = (height + size - 1) / size;
  std::array<std::vector<double>, 2> maps;
  maps.fill(std::vector<double>(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows)));
  for (const Event& e : events) maps[e.p][static_cast<std::size_t>(e.y / size) * columns + e.x / size] += 1;
  return maps;
}

// Radix sort: floats that are not negative have the order of their bit patterns.
void sort_not_negative(std::vector<float>& values) {
  constexpr int kDigit = 11, kDigits = 3;
  std::vector<float> sorted(values.size());
  for (int digit = 0; digit < kDigits; ++digit) {
    const auto of = [&](float v) { return std::bit_cast<std::uint32_t>(v) >> (digit * kDigit) & ((1U << kDigit) - 1); };
    std::array<std::size_t, 1 << kDigit> next{};
    for (const float v : values) ++next[of(v)];
    std::exclusive_scan(next.begin(), next.end(), next.begin(), std::size_t{0});
    for (const float v : values) sorted[next[of(v)]++] = v;
    values.swap(sorted);
  }
}

// log10 of the times between consecutive events of a pixel (at least 1 us), sorted. Sorts `events` by time first.
std::vector<float> log_intervals(std::vector<Event>& events, int width, int height) {
  const auto by_time = [](const Event& a, const Event& b) { return a.t_us < b.t_us; };
  if (!std::is_sorted(events.begin(), events.end(), by_time)) std::stable_sort(events.begin(), events.end(), by_time);
  std::vector<std::int64_t> last(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), -1);
  std::vector<float> intervals;
  for (const Event& e : events) {
    auto& before = last[static_cast<std::size_t>(e.y) * static_cast<std::size_t>(width) + e.x];
    if (before >= 0) intervals.push_back(std::log10(static_cast<float>(std::max<std::int64_t>(1, e.t_us - before))));
    before = e.t_us;
  }
  sort_not_negative(intervals);
  return intervals;
}

double quantile(const std::vector<float>& sorted, double part) {
  return sorted[static_cast<std::size_t>(part * static_cast<double>(sorted.size()))];
}

// 95 % intervals of the Chamfer and Gaussian distance by bootstrap: time blocks drawn with replacement, the same for
// both directions. A draw in which a stream has no events has no distance, and is repeated.
std::array<Interval, 2> bootstrap(const Distances& d, std::uint64_t seed) {
  constexpr int kDraws = 1000;
  std::vector<int> parts;
  for (int k = 0; k < kTimeBlocks; ++k)
    if (d.blocks[0].count[k] > 0 || d.blocks[1].count[k] > 0) parts.push_back(k);
  std::mt19937_64 random(seed);
  std::array<std::vector<double>, 2> draws;
  while (draws[0].size() < kDraws) {
    std::array<double, 2> distance{}, kernel{}, count{};
    for (std::size_t i = 0; i < parts.size(); ++i) {
      const int k = parts[random() % parts.size()];
      for (int way = 0; way < 2; ++way)
        distance[way] += d.blocks[way].distance[k], kernel[way] += d.blocks[way].kernel[k],
            count[way] += d.blocks[way].count[k];
    }
    if (count[0] == 0 || count[1] == 0) continue;
    draws[0].push_back(distance[0] / count[0] + distance[1] / count[1]);
    draws[1].push_back(kernel[0] / count[0] + kernel[1] / count[1]);
  }
  std::array<Interval, 2> intervals;
  for (int k = 0; k < 2; ++k) {
    std::sort(draws[k].begin(), draws[k].end());
    intervals[k] = {draws[k][kDraws / 40], draws[k][kDraws - 1 - kDraws / 40]};
  }
  return intervals;
}

// A fair coin per event: SplitMix64 of seed and index.
bool coin(std::uint64_t seed, std::uint64_t index) {
  std::uint64_t z = seed * 0xD1342543DE82EF95ULL + (index + 1) * 0x9E3779B97F4A7C15ULL;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
  return (z ^ (z >> 31)) >> 63;
}

// Noise floor: the distances between random halves; empty when a half is empty.
std::optional<Distances> floor_of(const std::vector<Event>& events, const MetricOptions& metric, std::uint64_t seed) {
  std::array<std::vector<Event>, 2> halves;
  for (std::size_t i = 0; i < events.size(); ++i) halves[coin(seed, i)].push_back(events[i]);
  if (halves[0].empty() || halves[1].empty()) return {};
  return distances(halves[0], halves[1], metric);
}

Json json_of(const Distances& d) {
  return {{"chamfer", d.chamfer()},
          {"chamfer_parts", d.chamfer_parts},
          {"gaussian", d.gaussian()},
          {"gaussian_parts", d.gaussian_parts}};
}

Json json_of(const StreamSummary& s) {
  return {{"events", s.events},           {"t_first_us", s.t_first_us},   {"t_last_us", s.t_last_us},
          {"rate_hz", s.rate_hz},         {"on_fraction", s.on_fraction}, {"on_rate_curve_hz", s.on_hz},
          {"off_rate_curve_hz", s.off_hz}};
}

}  // namespace

Comparison compare(events::Stream real, const std::string& real_name, events::Stream sim, const std::string& sim_name,
                   const CompareOptions& options) {
  if (options.window_us && *options.window_us < 1)
    throw Error(ExitCode::usage, fmt::format("window: got {} us, wanted at least 1 us", *options.window_us));
  if ((options.normalisation == Normalisation::shared || options.disk) &&
      (real.info.width != sim.info.width || real.info.height != sim.info.height))
    throw bad_input(sim_name, "sensor size", fmt::format("{}x{}", sim.info.width, sim.info.height),
                    fmt::format("{}x{} as in {} (pecs convert --decimate brings a recording to a smaller grid)",
                                real.info.width, real.info.height, real_name));

  // The common window.
  const Extent real_extent = keep_window(real.events, real_name, options);
  const Extent sim_extent = keep_window(sim.events, sim_name, options);
  if (const auto& d = options.disk; d && (d->time_us < static_cast<double>(real_extent.first_us) ||
                                          d->time_us > static_cast<double>(real_extent.last_us)))
    throw bad_input(real_name, "phase_time_us of the disk", fmt::format("{:.0f} us", d->time_us),
                    fmt::format("a time of the recording, {} to {} us", real_extent.first_us, real_extent.last_us));
  Comparison c;
  c.options = options;
  c.width = real.info.width, c.height = real.info.height;
  c.curve_us = std::max(extent_us(real.events), extent_us(sim.events));
  c.window_us = options.window_us.value_or(c.curve_us);

  // Distances and their noise floor, the distances between recordings that differ by chance only.
  const MetricOptions metric{
      .normalisation = options.normalisation, .width = c.width, .height = c.height, .window_us = c.window_us};
  c.distance = distances(real.events, sim.events, metric);
  if (options.split_half) c.floor = floor_of(real.events, metric, options.seed);
  if (options.split_half && !c.floor)
    c.warnings.push_back(fmt::format("{}: too few events for a split-half floor", real_name));

  const auto intervals = bootstrap(c.distance, options.seed);
  c.chamfer_interval = intervals[0], c.gaussian_interval = intervals[1];

  // Rates and polarities, over all pixels.
  const auto origin_us = [&](const Extent& file) { return options.common_origin ? 0 : file.first_us; };
  c.real = summary_of(real.events, origin_us(real_extent), c.curve_us, options.rate_bins);
  c.sim = summary_of(sim.events, origin_us(sim_extent), c.curve_us, options.rate_bins);
  c.on_correlation = correlation(c.real.on_hz, c.sim.on_hz);
  c.off_correlation = correlation(c.real.off_hz, c.sim.off_hz);
  c.rate_correlation = correlation(sum(c.real.on_hz, c.real.off_hz), sum(c.sim.on_hz, c.sim.off_hz));

  // Event maps and inter-event intervals.
  const auto real_maps = maps_of(real.events, real.info.width, real.info.height);
  const auto sim_maps = maps_of(sim.events, sim.info.width, sim.info.height);
  if (real.info.width == sim.info.width && real.info.height == sim.info.height) {
    c.off_map_correlation = correlation(real_maps[0], sim_maps[0]);
    c.on_map_correlation = correlation(real_maps[1], sim_maps[1]);
    c.map_correlation = correlation(sum(real_maps[0], real_maps[1]), sum(sim_maps[0], sim_maps[1]));
  }
  const auto real_intervals = log_intervals(real.events, real.info.width, real.info.height);
  const auto sim_intervals = log_intervals(sim.events, sim.info.width, sim.info.height);
  if (!real_intervals.empty()) c.real.interval_median_us = std::pow(10, quantile(real_intervals, 0.5));
  if (!sim_intervals.empty()) c.sim.interval_median_us = std::pow(10, quantile(sim_intervals, 0.5));
  if (!real_intervals.empty() && !sim_intervals.empty())
    c.interval_distance_decades = earth_mover_of_sorted(real_intervals, sim_intervals);

  // Delays behind the edges of a disk; log_intervals has sorted both streams by time.
  if (options.disk) {
    TurningDisk disk = *options.disk;
    disk.time_us -= static_cast<double>(origin_us(real_extent));
    c.delays = compare_delays(real.events, sim.events, c.width, c.height, c.curve_us, disk);
  }

  if (options.realism) c.realism = realism(real, sim, options.seed);
  if (options.realism && !c.realism)
    c.warnings.push_back(fmt::format("{}, {}: no realism: it requires {}", real_name, sim_name, kRealismRequires));

  constexpr double kWhole = 0.8;  // of the window
  for (const auto& [name, events] : {std::pair{real_name, &real.events}, {sim_name, &sim.events}})
    if (const std::int64_t end_us = extent_us(*events);
        static_cast<double>(end_us) < kWhole * static_cast<double>(c.window_us))
      c.warnings.push_back(fmt::format(
          "{}: events end after {} of the {} us that are compared; --window compares a time that both streams have",
          name, end_us, c.window_us));
  for (const auto& [name, s] : {std::pair{real_name, c.real}, {sim_name, c.sim}})
    if (s.on_fraction == 0 || s.on_fraction == 1)
      c.warnings.push_back(
          fmt::format("{}: all {} events are {}; distances to the other polarity are at least 100 units", name,
                      s.events, s.on_fraction == 1 ? "ON" : "OFF"));
  return c;
}

StreamSummary summary_of(const events::Recording& r, int rate_bins) {
  return summary_of(r.events, r.first_us, r.span_us, rate_bins);
}

Json to_json(const Comparison& c) {
  Json json = json_of(c.distance);
  json["normalisation"] = name_of(c.options.normalisation);
  json["origin"] = c.options.common_origin ? "zero" : "first-event";
  json["window_us"] = c.window_us;
  json["width"] = c.width;
  json["height"] = c.height;
  json["split_half"] = c.floor ? json_of(*c.floor) : Json(nullptr);
  json["seed"] = c.options.seed;
  json["real"] = json_of(c.real);
  json["sim"] = json_of(c.sim);
  json["event_ratio"] = static_cast<double>(c.sim.events) / static_cast<double>(c.real.events);
  json["rate_curve_us"] = c.curve_us;
  json["rate_correlation"] = or_null(c.rate_correlation);
  json["on_rate_correlation"] = or_null(c.on_correlation);
  json["off_rate_correlation"] = or_null(c.off_correlation);
  json["chamfer_interval"] = {c.chamfer_interval.low, c.chamfer_interval.high};
  json["gaussian_interval"] = {c.gaussian_interval.low, c.gaussian_interval.high};
  json["map_correlation"] = or_null(c.map_correlation);
  json["on_map_correlation"] = or_null(c.on_map_correlation);
  json["off_map_correlation"] = or_null(c.off_map_correlation);
  json["interval_distance_decades"] = or_null(c.interval_distance_decades);
  json["real"]["interval_median_us"] = or_null(c.real.interval_median_us);
  json["sim"]["interval_median_us"] = or_null(c.sim.interval_median_us);
  json["delays"] = c.delays ? to_json(*c.delays) : Json(nullptr);
  json["realism"] = c.realism ? to_json(*c.realism) : Json(nullptr);
  json["warnings"] = c.warnings;
  return json;
}

}  // namespace pecs::metrics
