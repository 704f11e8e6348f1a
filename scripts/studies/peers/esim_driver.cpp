// Runs the esim_py of a checkout of uzh-rpg/rpg_vid2e on frames in memory, and times it:
//   esim_driver FRAMES.f32 WIDTH HEIGHT COUNT STEP_S C_ON C_OFF REFRACTORY_S LOG_EPS OUT.f64
// FRAMES: raw float32, white = 1. OUT: rows of x, y, t [s], p. Prints the CPU seconds that the simulator took.
#include <Eigen/Core>
#include <algorithm>
#include <boost/filesystem.hpp>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <iostream>
#include <opencv2/core/core.hpp>
#include <sstream>
#include <vector>
#define private public  // its one function for a frame is not public
#include "esim.h"
#undef private

int main(int argc, char** argv) {
  if (argc != 11) return 2;
  const int width = std::atoi(argv[2]), height = std::atoi(argv[3]), count = std::atoi(argv[4]);
  const double step_s = std::atof(argv[5]);
  std::vector<float> values(static_cast<std::size_t>(width) * height * count);
  std::ifstream in(argv[1], std::ios::binary);
  if (!in.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(values.size() * 4))) return 3;

  const auto eps = static_cast<float>(std::atof(argv[9]));
  EventSimulator simulator(static_cast<float>(std::atof(argv[6])), static_cast<float>(std::atof(argv[7])),
                           static_cast<float>(std::atof(argv[8])), eps, true);
  std::vector<Event> events;
  const std::clock_t start = std::clock();
  for (int i = 0; i < count; ++i) {
    const cv::Mat frame(height, width, CV_32F, values.data() + static_cast<std::size_t>(i) * width * height);
    cv::Mat log;
    cv::log(frame + eps, log);
    simulator.imageCallback(log, i * step_s, events);
  }
  std::printf("%.6f\n", static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC);
  std::ofstream out(argv[10], std::ios::binary);
  for (const Event& e : events) {
    const double row[4] = {double(e.x_), double(e.y_), e.t_, double(e.polarity_)};
    out.write(reinterpret_cast<const char*>(row), sizeof row);
  }
  return out ? 0 : 5;
}
