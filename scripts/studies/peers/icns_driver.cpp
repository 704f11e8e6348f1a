// Runs the C++ program of an older commit of neuromorphicsystems/IEBCS (cpp/simu.h, b478243) on frames in memory, and
// prints its CPU seconds:  icns_driver FRAMES.f32 WIDTH HEIGHT COUNT STEP_US C_ON C_OFF NOISE LATENCY JITTER REFRACTORY
// TAU RATES OUT.f64 FRAMES: raw float32, in lux. RATES: 0, or the rate in Hz of each polarity's background. OUT: x, y,
// t [us], p.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <string>

#include "simu.h"

int main(int argc, char** argv) {
  if (argc != 15) return 2;
  const auto number = [&](int i) { return std::atof(argv[i]); };
  const int width = std::atoi(argv[2]), height = std::atoi(argv[3]), count = std::atoi(argv[4]);
  const std::size_t pixels = static_cast<std::size_t>(width) * height;
  std::vector<float> values(pixels * count);
  std::ifstream in(argv[1], std::ios::binary);
  if (!in.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(values.size() * 4))) return 3;

  SimuICNS simulator(height, width);
  simulator.set_th(number(6), number(7), number(8));
  simulator.set_lat(number(9), number(10), number(11), number(12));
  if (number(13) > 0) {  // its only noise: tables of cumulative rates, 9 bins a decade from .001 Hz
    std::vector<double> table(72, 0.0);
    for (int i = 0; i < 72; ++i) table[i] = std::pow(10.0, i / 9 - 3) * (i % 9 + 1) >= number(13) ? 1.0 : 0.0;
    long int size = 1;
    simulator.init_noise(table.data(), table.data(), size);
  } else {
    simulator.disableNoise();
  }
  std::vector<Event> events;
  std::vector<double> frame(pixels);
  double seconds = 0;
  for (int i = 0; i < count; ++i) {
    const float* first = values.data() + static_cast<std::size_t>(i) * pixels;
    frame.assign(first, first + pixels);
    const std::clock_t start = std::clock();
    if (i == 0)
      simulator.init_img(frame.data());
    else {
      std::vector<Event> now;
      simulator.update_img(frame.data(), static_cast<std::uint64_t>(number(5)), now);
      events.insert(events.end(), now.begin(), now.end());
    }
    seconds += static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  }
  std::printf("%.6f\n", seconds);
  std::ofstream out(argv[14], std::ios::binary);
  for (const Event& e : events) {
    const double row[4] = {double(e.y_), double(e.x_), double(e.ts_), double(e.p_)};
    out.write(reinterpret_cast<const char*>(row), sizeof row);
  }
  return out ? 0 : 5;
}
