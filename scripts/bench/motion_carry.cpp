// bench_motion_carry [--passes N] [--threads N]: planes of light carried along motion, 1280x720, Mpixel per second and
// core (CPU time), median of the passes, beside this machine's copy bandwidth. JSON, one line a scene.
//   turning  one surface that turns by 0.02 rad (16 px at the corners) and grows
//   objects  48 ellipses that move up to 16 px before a background that moves
//   still    nothing moves but one ellipse
#include <fmt/format.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <ctime>
#include <string>
#include <vector>

#include "measure.h"
#include "pecs/sensor/motion.h"

namespace {

using namespace pecs::bench;

using pecs::sensor::CarriedLight;
using pecs::sensor::Carrier;
constexpr int kWidth = 1280, kHeight = 720, kPlanes = 16;
constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;
constexpr std::size_t kHalf = pecs::sensor::kMotionChannels / 2;

struct Object {
  float x, y, rx, ry, dx, dy, z;
};

// The motion of what is at (x, y) at an end of the interval; `way` 1: forward.
struct Scene {
  std::vector<Object> objects;
  float turn = 0, grow = 0, drift = 0;
  void at(int x, int y, float way, float (&out)[kHalf]) const {
    const auto fx = static_cast<float>(x), fy = static_cast<float>(y);
    float dx = way * (drift - turn * (fy - 360) + grow * (fx - 640)),
          dy = way * (turn * (fx - 640) + grow * (fy - 360));
    float z = 10;
    for (const Object& o : objects) {
      const float from = way > 0 ? 0.0f : 1.0f, u = (fx - o.x - from * o.dx) / o.rx,
                  v = (fy - o.y - from * o.dy) / o.ry;
      if (u * u + v * v > 1 || o.z > z) continue;
      dx = way * o.dx, dy = way * o.dy, z = o.z;
    }
    for (int part = 1; part <= 4; ++part) {
      out[2 * part - 2] = 0.25f * static_cast<float>(part) * dx;
      out[2 * part - 1] = 0.25f * static_cast<float>(part) * dy;
    }
    out[kHalf - 2] = out[kHalf - 1] = z;
  }
  std::vector<float> layer() const {
    std::vector<float> out(2 * kHalf * kPixels);
    for (std::size_t i = 0; i < kPixels; ++i)
      for (std::size_t side = 0; side < 2; ++side) {
        float values[kHalf];
        at(static_cast<int>(i % kWidth), static_cast<int>(i / kWidth), side ? -1.0f : 1.0f, values);
        for (std::size_t c = 0; c < kHalf; ++c) out[(kHalf * side + c) * kPixels + i] = values[c];
      }
    return out;
  }
};

Scene make(const std::string& name) {
  if (name == "turning") return {{}, 0.02f, 0.005f, 0};
  Scene scene{{}, 0, 0, name == "objects" ? 3.0f : 0.0f};
  for (int k = 0; k < (name == "objects" ? 48 : 1); ++k) {
    const auto wave = [&](float by, float size) { return size * std::sin(by * static_cast<float>(k) + 0.3f); };
    scene.objects.push_back({640 + wave(1.7f, 600), 360 + wave(2.9f, 330), 50 + wave(1.1f, 20), 40 + wave(2.3f, 15),
                             wave(3.1f, 15), wave(0.7f, 10), 5 + wave(4.3f, 3)});
  }
  return scene;
}

void run(const std::string& name, int passes, int threads) {
  const std::vector<float> layer = make(name).layer();
  std::vector<float> first(kPixels), second(kPixels), copy(kPixels);
  for (std::size_t i = 0; i < kPixels; ++i) {
    const std::size_t x = i % kWidth, y = i / kWidth;
    first[i] = second[i] = 1 + 0.5f * std::sin(0.4f * static_cast<float>(x)) * std::cos(0.3f * static_cast<float>(y));
  }
  std::vector<std::vector<float>> out(kPlanes, std::vector<float>(kPixels));
  std::vector<double> fractions;
  std::vector<float*> planes;
  for (int k = 0; k < kPlanes; ++k) {
    fractions.push_back((k + 0.5) / kPlanes);
    planes.push_back(out[static_cast<std::size_t>(k)].data());
  }
  std::vector<double> prepares, carries, copies;
  for (int pass = 0; pass < passes; ++pass) {
    copies.push_back(seconds([&] {
      for (int k = 0; k < kPlanes; ++k) std::memcpy(copy.data(), k % 2 ? first.data() : second.data(), 4 * kPixels);
    }));
    const double start = cpu_s();
    const Carrier carrier(layer, kWidth, kHeight);
    prepares.push_back(cpu_s() - start);
    const float *a = first.data(), *b = second.data();
    carries.push_back(seconds([&] { CarriedLight(carrier, {&a, 1}, {&b, 1}).planes(fractions, planes); }));
  }
  const double pixels = static_cast<double>(kPixels) * kPlanes;
  fmt::print(
      R"({{"scene": "{}", "threads": {}, "mpixels_per_core_s": {:.1f}, "prepare_ms": {:.1f}, "of_copy": {:.4f}, )"
      R"("copy_mpixels_per_s": {:.0f}}})"
      "\n",
      name, threads, pixels / median(carries) * 1e-6, 1e3 * median(prepares), median(copies) / median(carries),
      pixels / median(copies) * 1e-6);
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> args(argv + 1, argv + argc);
  const int threads = option(args, "--threads", 1);
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
  for (const char* scene : {"turning", "objects", "still"}) run(scene, option(args, "--passes", 5), threads);
  return 0;
}
