// bench_pixel_speed SEQUENCE [--chip NAME] [--threads N] [--passes N] [--instructions avx512|avx2|sse4] [--dump FILE]:
// frames in memory to sorted events, by the wall's clock and by CPU time of all threads, beside this machine's copy
// bandwidth. JSON: medians of the passes, and the first one of the process (cold). Rates are of CPU time.
//   disk    346x260, 500 frames at 1 kHz: a turning disk of sectors
//   board   1280x720, 100 frames at 1 kHz: a moving checkerboard
//   static  1280x720, 100 frames
// --dump writes the frames (float32 [T][H][W], linear light) for other programs.
#include <fmt/format.h>
#include <hwy/targets.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <fstream>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "measure.h"
#include "pecs/platform.h"
#include "pecs/sensor/sensor.h"

namespace {

using namespace pecs::bench;

using namespace pecs;

struct Sequence {
  int width, height, frames;
  std::vector<float> values;
};

// Smooth step over one pixel around a signed distance to an edge, in pixels.
float edge(float distance, float dark, float bright) {
  return dark + (bright - dark) * std::clamp(distance + 0.5f, 0.0f, 1.0f);
}

Sequence make(const std::string& name) {
  const bool disk = name == "disk";
  Sequence s{disk ? 346 : 1280, disk ? 260 : 720, disk ? 500 : 100, {}};
  const std::size_t count =
      static_cast<std::size_t>(s.width) * static_cast<std::size_t>(s.height) * static_cast<std::size_t>(s.frames);
  s.values.reserve(count);
  platform::ask_for_huge_pages(s.values.data(), count * sizeof(float));  // as numpy does
  s.values.resize(count);
  constexpr float kDark = 90, kBright = 240;
  auto* out = s.values.data();
  for (int i = 0; i < s.frames; ++i)
    for (int y = 0; y < s.height; ++y)
      for (int x = 0; x < s.width; ++x, ++out) {
        if (disk) {
          const float dx = static_cast<float>(x) - 173, dy = static_cast<float>(y) - 130, r = std::hypot(dx, dy);
          const float turn = (std::atan2(dy, dx) + 0.0366f * static_cast<float>(i)) * 8 / std::numbers::pi_v<float>;
          const float phase = turn - 2 * std::floor(turn / 2);  // [0, 2): dark, then bright
          const float pixels = r * std::numbers::pi_v<float> / 8;
          const float to_edge = phase < 1 ? -std::min(phase, 1 - phase) : std::min(phase - 1, 2 - phase);
          *out = r > 126 ? 120.0f : edge(to_edge * pixels, kDark, kBright);
        } else {
          const float shift = name == "static" ? 0 : 0.7f * static_cast<float>(i);
          const float u = (static_cast<float>(x) + shift) / 60, v = static_cast<float>(y) / 60;
          const float du = u - 2 * std::floor(u / 2);
          const bool odd = static_cast<int>(v) % 2;
          float to_edge = du < 1 ? -std::min(du, 1 - du) : std::min(du - 1, 2 - du);
          if (odd) to_edge = -to_edge;
          *out = edge(to_edge * 60, kDark, kBright);
        }
      }
  return s;
}

// Wall and CPU time of a piece of work, all threads together.
struct Spent {
  double wall_s, cpu_s;
};
Spent spent(auto&& work) {
  const auto start = std::chrono::steady_clock::now();
  const double cpu = seconds(work);
  return {std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(), cpu};
}

double median_of(const std::vector<Spent>& passes, double Spent::* what) {
  std::vector<double> values;
  for (const Spent& s : passes) values.push_back(s.*what);
  return median(values);
}

// A sensor from its construction to its last event; how many events. They are handed on batch by batch, as to a file.
std::size_t sense(const Sequence& s, const sensor::Chip& chip) {
  const std::size_t plane = static_cast<std::size_t>(s.width) * static_cast<std::size_t>(s.height);
  std::size_t count = 0;
  sensor::Sensor sensor(chip, s.width, s.height, 1, 1.0);
  sensor::LabelledEvents events;
  for (int first = 0; first < s.frames; first += 64) {
    std::vector<const float*> planes;
    std::vector<double> t_us;
    for (int i = first; i < std::min(first + 64, s.frames); ++i) {
      planes.push_back(s.values.data() + static_cast<std::size_t>(i) * plane);
      t_us.push_back(1000.0 * i);
    }
    events.events.clear();
    sensor.push(planes, t_us, first + 64 >= s.frames, events);
    count += events.events.size();
  }
  return count;
}

// Leaves out what is better than these instructions.
void use_instructions(const std::string& name) {
  for (const auto& [known, target] :
       {std::pair{"avx512", std::int64_t{HWY_AVX3}}, {"avx2", HWY_AVX2}, {"sse4", HWY_SSE4}})
    if (name == known) hwy::DisableTargets(target - 1);
}

int run(const std::vector<std::string>& args) {
  const Sequence s = make(args.at(0));
  if (const std::string dump = option(args, "--dump", ""); !dump.empty()) {
    std::ofstream file(dump, std::ios::binary);
    file.write(reinterpret_cast<const char*>(s.values.data()),
               static_cast<std::streamsize>(s.values.size() * sizeof(float)));
  }
  use_instructions(option(args, "--instructions", ""));
  const int threads = option(args, "--threads", 1), passes = option(args, "--passes", 5);
  const sensor::Chip chip = sensor::load_chip(option(args, "--chip", "ideal"));
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));

  std::size_t count = 0;
  const Spent cold = spent([&] { count = sense(s, chip); });
  std::vector<float> copy(s.values.size());
  std::vector<Spent> ours, copies;
  for (int pass = 0; pass < passes; ++pass) {
    copies.push_back(spent([&] { std::memcpy(copy.data(), s.values.data(), s.values.size() * sizeof(float)); }));
    ours.push_back(spent([&] { count = sense(s, chip); }));
  }
  const auto least = std::ranges::min_element(ours, {}, &Spent::cpu_s);
  const double cpu_s = median_of(ours, &Spent::cpu_s), copy_s = median_of(copies, &Spent::cpu_s);
  const double pixels = static_cast<double>(s.values.size());
  fmt::print(
      R"({{"sequence": "{}", "chip": "{}", "threads": {}, "passes": {}, "events": {}, "seconds": {:.4f}, )"
      R"("cpu_s": {:.4f}, "least_cpu_s": {:.4f}, "cold_s": {:.4f}, "cold_cpu_s": {:.4f}, "mpixel_frames_per_s": {:.1f}, )"
      R"("mevents_per_s": {:.2f}, "copy_mpixels_per_s": {:.1f}, "of_copy": {:.3f}}})"
      "\n",
      args[0], chip.name, threads, passes, count, median_of(ours, &Spent::wall_s), cpu_s, least->cpu_s, cold.wall_s,
      cold.cpu_s, pixels / cpu_s * 1e-6, static_cast<double>(count) / cpu_s * 1e-6, pixels / copy_s * 1e-6,
      copy_s / cpu_s);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> args(argv + 1, argv + argc);
  if (args.empty() || (args[0] != "disk" && args[0] != "board" && args[0] != "static")) {
    fmt::print(stderr,
               "usage: bench_pixel_speed disk|board|static [--chip NAME] [--threads N] [--passes N] "
               "[--instructions avx512|avx2|sse4] [--dump FILE]\n");
    return 2;
  }
  return run(args);
}
