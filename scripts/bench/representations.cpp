// bench_representations [--passes N] [--events N]: events as planes (voxel grid of 5 bins, time surface, histogram of
// 10 bins of both polarities), one thread, one window a call with all its events: Mevents per second (CPU time, median
// of the passes), and how that compares with copying the same events on this machine. JSON, one line a picture size and
// kind of events:
//   edges    along lines that move, as cameras give them
//   random   every event at a pixel of its own: the caches' worst case
#include "pecs/events/representations.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <ctime>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "measure.h"

namespace {

using namespace pecs::bench;

using pecs::events::Event;

std::vector<Event> make(bool edges, int width, int height, std::size_t count) {
  std::mt19937 random(1);
  std::vector<Event> events(count);
  for (std::size_t i = 0; i < count; ++i) {
    Event& e = events[i];
    e.t_us = static_cast<std::int64_t>(50'000 * i / count);
    const auto line = static_cast<double>(random() % 24),
               y = static_cast<double>(random() % static_cast<unsigned>(height));
    const double x = edges ? std::fmod(line * 0.31 * width + 0.4 * y + 4e-4 * static_cast<double>(e.t_us), width)
                           : static_cast<double>(random() % static_cast<unsigned>(width));
    e.x = static_cast<std::uint16_t>(x), e.y = static_cast<std::uint16_t>(y);
    e.p = static_cast<std::uint8_t>(random() % 2);
  }
  return events;
}

void run(bool edges, int width, int height, int passes, std::size_t count) {
  const std::vector<Event> events = make(edges, width, height, count);
  std::vector<Event> copy(count);
  const pecs::events::EventWindow window{width, height, 0, 50'000};
  const std::size_t pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  std::vector<float> out(20 * pixels);
  const auto planes = [&](std::size_t n) { return std::span(out).first(n * pixels); };
  const std::pair<const char*, std::function<void()>> works[] = {
      {"copy", [&] { std::memcpy(copy.data(), events.data(), count * sizeof(Event)); }},
      {"voxel_grid", [&] { voxel_grid(events, window, 5, false, planes(5)); }},
      {"voxel_grid_normalised", [&] { voxel_grid(events, window, 5, true, planes(5)); }},
      {"time_surface", [&] { time_surface(events, window, 10'000, planes(2)); }},
      {"event_histogram", [&] { event_histogram(events, window, 10, planes(20)); }}};
  std::string line = fmt::format(R"({{"size": "{}x{}", "events": "{}", "count": {})", width, height,
                                 edges ? "edges" : "random", count);
  double copy_s = 0;
  for (const auto& [name, work] : works) {
    std::vector<double> times;
    work();  // pages are there
    for (int pass = 0; pass < passes; ++pass) {
      times.push_back(seconds(work));
    }
    const double median_s = median(times);
    if (copy_s == 0) copy_s = median_s;
    line += fmt::format(R"(, "{}": {{"mevents_per_s": {:.0f}, "of_copy": {:.3f}}})", name,
                        1e-6 * static_cast<double>(count) / median_s, copy_s / median_s);
  }
  fmt::print("{}}}\n", line);
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> args(argv + 1, argv + argc);
  const int passes = std::max(1, option(args, "--passes", 9)), count = std::max(1, option(args, "--events", 1'000'000));
  for (const auto& [width, height] : {std::pair{346, 260}, {1280, 720}})
    for (const bool edges : {true, false}) run(edges, width, height, passes, static_cast<std::size_t>(count));
  return 0;
}
