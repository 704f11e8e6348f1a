#include "patches.h"

#include <algorithm>
#include <cmath>

namespace pecs::metrics {
namespace {

using events::Event;

constexpr int kPatch = 32, kLeast = 20;
constexpr std::int64_t kTime_us = 10'000, kNever = -1'000'000, kIsolated_us = 5000;
constexpr std::array<float, 5> kGapEdges{2.5F, 3, 3.5F, 4, 4.5F};  // log10 us
constexpr std::size_t kGapBins = kGapEdges.size() + 1;

float log10_us(std::int64_t t) { return std::log10(static_cast<float>(std::clamp<std::int64_t>(t, 1, 1'000'000))); }

// A sensor with a border of one pixel, so that every pixel has eight neighbours.
template <class T>
struct Bordered {
  int stride;
  std::vector<T> values;
  Bordered(int width, int height, T value)
      : stride(width + 2), values(static_cast<std::size_t>(width + 2) * static_cast<std::size_t>(height + 2), value) {}
  std::size_t at(int x, int y) const { return static_cast<std::size_t>(y + 1) * stride + x + 1; }
  std::array<std::size_t, 8> around(std::size_t i) const {
    const auto s = static_cast<std::size_t>(stride);
    return {i - s - 1, i - s, i - s + 1, i - 1, i + 1, i + s - 1, i + s, i + s + 1};
  }
};

// Cues of an event that depend on others: log10 us since the last event of its pixel (none: -1) and whether that had
// the other polarity; log10 us since the last event of its polarity of the eight neighbours; whether it has no event
// of pixel or neighbours within kIsolated_us.
struct Around {
  float interval = -1, neighbour = 0;
  bool opposite = false, isolated = true;
};

std::vector<Around> around_of(std::span<const Event> events, int width, int height) {
  std::array<Bordered<std::int64_t>, 2> last{{{width, height, kNever * 2}, {width, height, kNever * 2}}};
  Bordered<std::int64_t> latest(width, height, -1);  // index of the event
  std::vector<Around> found(events.size());
  for (std::size_t i = 0; i < events.size(); ++i) {
    const Event& e = events[i];
    const std::size_t pixel = latest.at(e.x, e.y);
    Around& a = found[i];
    std::int64_t before = kNever * 2;
    for (const std::size_t k : latest.around(pixel)) {
      before = std::max(before, last[e.p].values[k]);
      const std::int64_t other = latest.values[k];
      if (other < 0 || e.t_us - events[static_cast<std::size_t>(other)].t_us > kIsolated_us) continue;
      a.isolated = found[static_cast<std::size_t>(other)].isolated = false;
    }
    a.neighbour = log10_us(e.t_us - before);
    if (const std::int64_t own = latest.values[pixel]; own >= 0) {
      const Event& previous = events[static_cast<std::size_t>(own)];
      a.interval = log10_us(e.t_us - previous.t_us), a.opposite = previous.p != e.p;
    }
    last[e.p].values[pixel] = e.t_us;
    latest.values[pixel] = static_cast<std::int64_t>(i);
  }
  return found;
}

// Sums over a block in one half of the time.
struct Pattern {
  double covariance = 0, square = 0, hot = 0, hot_pixels = 0, all = 0, on = 0;
};

// Counts of the pixels in the four quarters of the time.
using Quarters = std::array<Bordered<float>, 4>;

// Pixels with more than three times the events of their neighbours, in both halves of the time.
std::vector<bool> hot_pixels(const Quarters& counts, int width, int height) {
  std::vector<bool> hot(counts[0].values.size());
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const std::size_t pixel = counts[0].at(x, y);
      hot[pixel] = true;
      for (const std::size_t q : {0, 2}) {
        const auto count = [&](std::size_t k) { return counts[q].values[k] + counts[q + 1].values[k] + 2; };
        std::array<float, 8> others{};
        std::ranges::transform(counts[0].around(pixel), others.begin(), count);
        std::ranges::nth_element(others, others.begin() + 5);  // above the median: other hot pixels may be there
        if (count(pixel) <= 3 * others[5]) hot[pixel] = false;
      }
    }
  return hot;
}

// How far pixels differ from their neighbours: the covariance of their deviations in two quarters of the time, to which
// chance adds nothing.
std::vector<Pattern> patterns_of(const Quarters& counts, const std::vector<bool>& hot, int width, int height,
                                 std::size_t half) {
  const int columns = width / kPatch, rows = height / kPatch;
  std::vector<Pattern> patterns(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows));
  for (int y = 0; y < rows * kPatch; ++y)
    for (int x = 0; x < columns * kPatch; ++x) {
      Pattern& p = patterns[static_cast<std::size_t>(y / kPatch) * columns + x / kPatch];
      const std::size_t pixel = counts[0].at(x, y);
      std::array<double, 2> own{}, mean{};
      for (std::size_t q = 0; q < 2; ++q) {
        const auto& of = counts[2 * half + q];
        own[q] = of.values[pixel];
        double n = 0;
        for (const std::size_t k : of.around(pixel))
          if (!hot[k]) mean[q] += of.values[k], ++n;
        mean[q] /= std::max(n, 1.0);
      }
      p.all += own[0] + own[1];
      if (hot[pixel]) {
        p.hot += own[0] + own[1], ++p.hot_pixels;
        continue;
      }
      for (std::size_t q = 0; q < 2; ++q) own[q] = std::min(own[q], 3 * mean[q] + 3);
      p.covariance += (own[0] - mean[0]) * (own[1] - mean[1]);
      p.square += mean[0] * mean[1];
    }
  return patterns;
}

struct Sums {
  int n = 0, all = 0, equal = 0, isolated = 0;  // n: not isolated
  std::int64_t before_us = -1;
  double interval = 0, neighbour = 0;
  std::array<int, 2> of{};
  std::array<std::array<int, kGapBins>, 4> intervals{};  // by polarity and whether the one before was the other
  std::array<std::array<int, kGapBins>, 2> neighbours{};

  void add(const Event& e, const Around& a) {
    const auto bin = [](float value) {
      return static_cast<std::size_t>(std::ranges::upper_bound(kGapEdges, value) - kGapEdges.begin());
    };
    equal += e.t_us == before_us, ++all, isolated += a.isolated;
    before_us = e.t_us;
    if (a.isolated) return;
    ++n, ++of[e.p];
    if (a.interval >= 0)
      interval += a.interval, ++intervals[std::size_t{2} * e.p + static_cast<std::size_t>(a.opposite)][bin(a.interval)];
    else
      interval += 6;
    neighbour += a.neighbour, ++neighbours[e.p][bin(a.neighbour)];
  }

  std::array<float, kFeatures> values(const Pattern& p) const {
    std::array<float, kFeatures> v{};
    auto next = v.begin();
    const auto put = [&](double value) { *next++ = static_cast<float>(value); };
    const auto shares = [&](const auto& bins, int total) {
      for (std::size_t k = 0; k + 1 < bins.size(); ++k) put(double(bins[k]) / std::max(total, 1));
    };
    put(std::log10(n)), put(double(equal) / all);
    put(p.hot / std::max(p.all, 1.0)), put(p.hot_pixels);
    put(p.square > 0 ? p.covariance / p.square : 0);
    put(double(isolated) / all), put(isolated);
    put(double(of[1]) / n), put(p.on / std::max(p.all - p.hot, 1.0));
    put(interval / n);
    for (std::size_t k = 0; k < 4; ++k) shares(intervals[k], of[k / 2]);
    put(neighbour / n);
    for (std::size_t k = 0; k < 2; ++k) {
      shares(neighbours[k], of[k]);
    }
    return v;
  }
};

}  // namespace

std::vector<Patch> patches_of(std::span<const Event> all, int width, int height, std::int64_t end_us,
                              std::int64_t tick_us) {
  // Hot pixels are a cue, and in no other cue.
  const Bordered<float> none(width, height, 0);
  Quarters counts{none, none, none, none};
  for (const Event& e : all) counts[static_cast<std::size_t>(4 * e.t_us / end_us)].values[none.at(e.x, e.y)] += 1;
  const auto hot = hot_pixels(counts, width, height);
  std::vector<Event> events;
  std::ranges::copy_if(all, std::back_inserter(events), [&](const Event& e) { return !hot[none.at(e.x, e.y)]; });

  // So are isolated events.
  std::vector<Event> coarse = events;
  for (Event& e : coarse) e.t_us -= e.t_us % tick_us;
  auto around = around_of(coarse, width, height);
  std::vector<Event> supported;
  for (std::size_t i = 0; i < coarse.size(); ++i)
    if (!around[i].isolated) supported.push_back(coarse[i]);
  const auto among_supported = around_of(supported, width, height);
  for (std::size_t i = 0, k = 0; i < around.size(); ++i)
    if (!around[i].isolated) around[i] = among_supported[k++], around[i].isolated = false;

  std::array patterns{patterns_of(counts, hot, width, height, 0), patterns_of(counts, hot, width, height, 1)};
  const int columns = width / kPatch, rows = height / kPatch;
  const auto block_of = [&](const Event& e) {
    return static_cast<std::size_t>(e.y / kPatch) * static_cast<std::size_t>(columns) +
           static_cast<std::size_t>(e.x / kPatch);
  };
  for (const Event& e : events)
    if (e.x / kPatch < columns && e.y / kPatch < rows)
      patterns[static_cast<std::size_t>(2 * e.t_us / end_us)][block_of(e)].on += e.p;

  std::vector<Patch> patches;
  std::vector<Sums> sums;
  const auto close = [&](std::int64_t slot) {
    const std::size_t half = 2 * slot * kTime_us >= end_us ? 1 : 0;
    for (std::size_t block = 0; block < sums.size(); ++block)
      if (sums[block].n >= kLeast)
        patches.push_back({static_cast<std::uint32_t>(block),
                           static_cast<int>(2 * half + (block / columns + block % columns) % 2),
                           sums[block].values(patterns[half][block])});
  };
  std::int64_t slot = -1;
  for (std::size_t i = 0; i < events.size(); ++i) {
    const Event& e = events[i];
    const std::int64_t now = e.t_us / kTime_us;
    if (now != slot) {
      close(slot);
      sums.assign(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows), {});
      slot = now;
    }
    if ((slot + 1) * kTime_us <= end_us && e.x / kPatch < columns && e.y / kPatch < rows)
      sums[block_of(e)].add(e, around[i]);
  }
  close(slot);
  return patches;
}

}  // namespace pecs::metrics
