#pragma once
// The inner loop over frames for a range of pixels, compiled for each instruction set (kernel.cpp). A kernel for
// another device starts from KernelArguments and the equations in photoreceptor.h, amplifier.h and cubic.h.
#include "models/pecs/interval.h"
#include "models/pecs/pixels.h"

namespace pecs::sensor {

struct KernelArguments {
  PixelConstants constants;
  float dark_fa, gain_fa, noise_std;
  std::uint64_t seed, noise_seed;
  bool random_phase;  // pixels begin at a random distance from their thresholds
  // Arrays start at pixel 0 and are padded by kMaxLanes. Equal thresholds: kMaxLanes of each.
  bool equal_thresholds;
  const float *threshold_on, *threshold_off;
  float *light0, *light1;  // of the last two frames: I [fA] (run_kernel) or ln I (run_threshold_kernel)
  float *m0, *reference, *blind_us, *w;
  float *y, *n, *z;  // with an amplifier: its output; noise before and behind it (noise.h)
  float* e;          // slow part of the steps by exposures; null: none
  std::span<const float* const> planes;
  std::int64_t first_frame;
  double start_us;                           // time of the first known frame
  std::span<const IntervalTimes> intervals;  // one per plane from frame 2 on, and one more when the stream ends
  bool last;                                 // the last of `intervals` has no frame after it
  std::uint32_t first, count;
  std::span<const BackgroundEvent> background;  // by pixel; within these intervals
  ExposureSteps exposures;                      // at least those within these intervals
  EventSlots* events;
  ResetMark* marks;  // null: causes are not recorded
};

inline constexpr std::uint32_t kMaxLanes = 64;

void run_kernel(const KernelArguments& arguments);
// For pixels with thresholds only: no photoreceptor, refractory period, leak, background or random phase
// (threshold_kernel.cpp). All events are signal.
void run_threshold_kernel(const KernelArguments& arguments);

}  // namespace pecs::sensor
