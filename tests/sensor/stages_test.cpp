// Bursts, flicker and a flash by hand; properties over random streams.
#include "pecs/sensor/stages.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <tuple>

#include "shared.h"

namespace pecs::sensor {
namespace {

using events::Event;
using Events = std::vector<Event>;

struct Filtered {
  Events events;
  std::vector<DroppedEvent> dropped;
  StageCounts counts;
};

// In chunks of so many events; 0: at once.
Filtered filtered(const StageOptions& options, const Events& in, int side = 32, std::size_t chunk = 0) {
  EventStages stages(options, side, side);
  Filtered out;
  const std::size_t step = chunk ? chunk : in.size();
  for (std::size_t i = 0; i < in.size(); i += step) {
    const std::size_t end = std::min(in.size(), i + step);
    LabelledEvents part{{in.begin() + static_cast<std::ptrdiff_t>(i), in.begin() + static_cast<std::ptrdiff_t>(end)},
                        {}};
    part.causes.assign(part.events.size(), Cause::noise);
    stages.before_readout(part);
    stages.after_readout(part, end == in.size(), &out.dropped);
    EXPECT_EQ(part.causes.size(), part.events.size());
    out.events.insert(out.events.end(), part.events.begin(), part.events.end());
  }
  out.counts = stages.counts();
  return out;
}

std::vector<std::int64_t> times(const Events& events) {
  std::vector<std::int64_t> out;
  for (const Event& e : events) out.push_back(e.t_us);
  return out;
}

StageOptions with(TrailFilter kind) { return {.roi = {}, .mask = {}, .afk = {}, .trail = kind}; }

StageOptions with(Afk afk) { return {.roi = {}, .mask = {}, .afk = afk, .trail = {}}; }

StageOptions limited(double rate_hz) {
  StageOptions out;
  out.erc_hz = rate_hz;
  return out;
}

// The pixels of a block under a lamp: 3 ON events in the first half of each period and 3 OFF ones in the second, each
// pixel up to 300 us later than the first.
Events lamp(double hz, std::int64_t from_us, std::int64_t to_us, std::uint16_t left = 8) {
  Events out;
  const double period_us = 1e6 / hz;
  for (double t = static_cast<double>(from_us); t < static_cast<double>(to_us); t += period_us)
    for (int k = 0; k < 6; ++k)
      for (std::uint16_t i = 0; i < 16; ++i) {
        const double at = t + period_us * (k < 3 ? 0.05 * k : 0.5 + 0.05 * (k - 3)) + period_us * 0.03 * i / 16;
        out.push_back({static_cast<std::int64_t>(at), static_cast<std::uint16_t>(left + i % 4),
                       static_cast<std::uint16_t>(4 + i / 4), static_cast<std::uint8_t>(k < 3)});
      }
  std::ranges::sort(out, {}, [](const Event& e) { return std::tuple(e.t_us, e.y, e.x); });
  return out;
}

double part_kept(const Filtered& f, const Events& in, std::int64_t from_us) {
  const auto late = [&](const Event& e) { return e.t_us >= from_us; };
  return static_cast<double>(std::ranges::count_if(f.events, late)) /
         static_cast<double>(std::ranges::count_if(in, late));
}

Events random_stream(unsigned seed) {
  std::mt19937 random(seed);
  Events out;
  for (std::int64_t t = 0; t < 400'000; t += random() % 40)
    for (std::size_t n = 1 + random() % 6; n > 0; --n)
      out.push_back({t, static_cast<std::uint16_t>(random() % 32), static_cast<std::uint16_t>(random() % 32),
                     static_cast<std::uint8_t>(random() % 2)});
  const Events flicker = lamp(120, 50'000, 300'000);
  out.insert(out.end(), flicker.begin(), flicker.end());
  std::ranges::sort(out, {}, [](const Event& e) { return std::tuple(e.t_us, e.y, e.x); });
  return out;
}

}  // namespace

// A burst of four ON events, a lone OFF, two ON events that are exactly the threshold apart, two more within it.
TEST(Stages, BurstsByHand) {
  const Events in = {{0, 3, 3, 1},      {2'000, 3, 3, 1},  {11'000, 3, 3, 1}, {20'000, 3, 3, 1}, {21'000, 3, 3, 0},
                     {50'000, 3, 3, 1}, {60'000, 3, 3, 1}, {65'000, 3, 3, 1}, {66'000, 3, 3, 1}, {66'000, 4, 3, 1}};
  using Times = std::vector<std::int64_t>;
  EXPECT_EQ(times(filtered(with(TrailFilter::first), in).events), Times({0, 21'000, 50'000, 60'000, 66'000}));
  EXPECT_EQ(times(filtered(with(TrailFilter::second), in).events), Times({2'000, 65'000}));
  EXPECT_EQ(times(filtered(with(TrailFilter::all_but_first), in).events),
            Times({2'000, 11'000, 20'000, 65'000, 66'000}));
}

TEST(Stages, AfkDropsFlickerInItsBandAlone) {
  for (const double hz : {100.0, 120.0, 400.0}) {
    const Events in = lamp(hz, 1000, 1'000'000);
    const auto settled_us = static_cast<std::int64_t>(9e6 / hz);
    const Filtered stopped = filtered(with(Afk{50, 520}), in);
    EXPECT_EQ(part_kept(stopped, in, settled_us), 0) << hz;
    EXPECT_GT(stopped.events.size(), 0u);  // the periods before it starts
    EXPECT_EQ(part_kept(filtered(with(Afk{.low_hz = 50, .high_hz = 520, .pass = true}), in), in, settled_us), 1) << hz;
  }
  for (const double hz : {30.0, 45.0, 600.0, 2000.0}) {
    const Events in = lamp(hz, 1000, 1'000'000);
    EXPECT_EQ(filtered(with(Afk{50, 520}), in).events.size(), in.size()) << hz;
    EXPECT_EQ(filtered(with(Afk{.low_hz = 50, .high_hz = 520, .pass = true}), in).events.size(), 0u) << hz;
  }
  EXPECT_EQ(filtered(with(Afk{50, 90}), lamp(100, 1000, 500'000)).counts[static_cast<std::size_t>(Stage::afk)], 0);
}

TEST(Stages, AfkStartsAndStopsByBlock) {
  // A lamp from .1 to .3 s; then, .2 s later, one ON event; another block sees one bright edge during the flicker.
  Events in = lamp(100, 100'000, 300'000);
  in.push_back({500'000, 9, 5, 1});
  const Event edge{250'000, 20, 5, 1};
  in.insert(std::ranges::upper_bound(in, edge.t_us, {}, &Event::t_us), edge);
  const Filtered out = filtered(with(Afk{50, 520}), in);
  EXPECT_EQ(out.events.back(), in.back());
  EXPECT_EQ(std::ranges::count(out.events, edge), 1);
  // Six counted periods; the first rise with an OFF event before it is the second one.
  const auto lost = std::ranges::min(out.dropped, {}, [](const DroppedEvent& d) { return d.event.t_us; });
  EXPECT_NEAR(static_cast<double>(lost.event.t_us), 170'000, 500);
}

TEST(Stages, AFlashBeyondTheLimit) {
  Events in;
  for (int i = 0; i < 9000; ++i)  // a flash: 9,000 events in 100 us, then 20 calm periods
    in.push_back({1'000 + i / 90, static_cast<std::uint16_t>(i % 32), static_cast<std::uint16_t>(i / 32 % 32), 1});
  for (int i = 0; i < 400; ++i) in.push_back({2'000 + 10 * i, 3, 3, 1});
  const Filtered out = filtered(limited(20e6), in);
  EXPECT_EQ(out.events.size(), 4'000u + 400u);  // 4,000 of 200 us, and all of the calm
  EXPECT_EQ(out.counts[static_cast<std::size_t>(Stage::erc)], 5'000);
  // Evenly: each 10 us of the flash keep 400 of 900.
  for (int t = 0; t < 100; t += 10)
    EXPECT_NEAR(static_cast<double>(std::ranges::count_if(
                    out.events, [&](const Event& e) { return e.t_us >= 1'000 + t && e.t_us < 1'010 + t; })),
                400, 1);
  const Events around_0 = {{-150, 3, 3, 1}, {-2, 3, 3, 1}, {-1, 3, 3, 1}, {0, 3, 3, 1}, {199, 3, 3, 1}, {200, 3, 3, 1}};
  EXPECT_EQ(times(filtered(limited(1e4), around_0).events), (std::vector<std::int64_t>{-2, -1, 0, 199, 200}));
}

TEST(Stages, RegionsAndMask) {
  const auto file = std::filesystem::temp_directory_path() / "pecs_stages_mask.txt";
  std::ofstream(file) << "# two defects\npixel 5 6\n\nrow 7  # all of it\ncolumn 9\n";
  Events in;
  for (std::uint16_t y = 0; y < 32; ++y)
    for (std::uint16_t x = 0; x < 32; ++x) in.push_back({0, x, y, 1});
  StageOptions options{.roi = {{4, 4, 8, 8}, {10, 10, 4, 4}}, .mask = file, .afk = {}, .trail = {}};
  const Filtered out = filtered(options, in);
  const std::int64_t inside = 64 + 16 - 4;
  EXPECT_EQ(out.counts[static_cast<std::size_t>(Stage::roi)], 1024 - inside);
  EXPECT_EQ(out.counts[static_cast<std::size_t>(Stage::mask)], 1 + 8 + 8 - 1);
  EXPECT_EQ(std::ssize(out.events), inside - 16);
  for (const char* wrong : {"pixel 5\n", "row 32\n", "column -1\n", "pixel 1 2 3\n", "spot 1 2\n"}) {
    std::ofstream(file) << "row 1\n" << wrong;
    pecs::tests::expect_error([&] { read_mask(file, 32, 32); }, ExitCode::bad_input, "line 2");
  }
  std::filesystem::remove(file);
  options = {};
  options.roi = {{30, 0, 3, 1}};
  EXPECT_THROW(EventStages(options, 32, 32), Error);
}

TEST(Stages, RandomStreams) {
  std::vector<StageOptions> all(8);
  all[0].trail = TrailFilter::first;
  all[1].trail = TrailFilter::second;
  all[2].trail = TrailFilter::all_but_first;
  all[3].afk = Afk{50, 520};
  all[4].afk = Afk{.low_hz = 100, .high_hz = 300, .pass = true};
  all[5].erc_hz = 5e4;
  all[6].roi = {{3, 3, 20, 20}};
  all[7] = {.roi = {{0, 0, 32, 20}},
            .mask = {},
            .afk = Afk{50, 520},
            .trail = TrailFilter::first,
            .trail_us = 3'000,
            .erc_hz = 3e4};
  const auto key = [](const Event& e) { return std::tuple(e.t_us, e.y, e.x, e.p); };
  for (unsigned seed = 1; seed <= 3; ++seed) {
    const Events in = random_stream(seed);
    for (const StageOptions& options : all) {
      const Filtered whole = filtered(options, in);
      EXPECT_LT(whole.events.size(), in.size());
      EXPECT_GT(whole.events.size(), 0u);
      EXPECT_TRUE(std::ranges::is_sorted(whole.events, {}, &Event::t_us));
      // Each event is kept or dropped once.
      Events together = whole.events;
      for (const DroppedEvent& d : whole.dropped) together.push_back(d.event);
      Events expected = in;
      if (!options.roi.empty())
        std::erase_if(expected, [&](const Event& e) {
          const RoiWindow& w = options.roi[0];
          return e.x < w.x || e.x >= w.x + w.width || e.y < w.y || e.y >= w.y + w.height;
        });
      std::ranges::sort(together, {}, key);
      std::ranges::sort(expected, {}, key);
      EXPECT_EQ(together, expected);
      if (options.erc_hz > 0) {
        std::map<std::int64_t, double> counts;
        for (const Event& e : whole.events) ++counts[e.t_us / kErcPeriod_us];
        for (const auto& [period, count] : counts) EXPECT_LE(count, options.erc_hz * 200e-6);
      }
      for (const std::size_t chunk : {1u, 7u, 1000u}) {
        const Filtered parts = filtered(options, in, 32, chunk);
        EXPECT_EQ(parts.events, whole.events);
        EXPECT_EQ(parts.counts, whole.counts);
      }
    }
  }
}

}  // namespace pecs::sensor
