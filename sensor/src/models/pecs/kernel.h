#pragma once
// The inner loop over frames for a run of pixels, compiled for each instruction set (kernel.cpp).
#include "models/pecs/pixels.h"

namespace pecs::sensor {

// Constants of the interval that starts at frame k, with what the slope at frame k + 1 needs.
struct IntervalTimes {
  double t0_us, t1_us;
  float h_us, per_h, per_next;                 // duration, 1 / duration, 1 / duration of the next interval
  float weight_this, weight_next, weight_sum;  // of the harmonic mean: of 1 / slope of this interval and of the next
  std::int64_t step;                           // index of the interval since the start
};

struct KernelArguments {
  PixelConstants constants;
  float dark_fa, gain_fa, noise_std;
  std::uint64_t seed;
  // Arrays start at pixel 0 and are padded by kMaxLanes. Equal thresholds: kMaxLanes of each.
  bool equal_thresholds;
  const float *threshold_on, *threshold_off;
  float *light0, *light1;  // of the last two frames, as the kernel keeps it: I [fA] or ln I
  float *m0, *reference, *blind_us, *w, *noise;
  std::span<const float* const> planes;
  std::int64_t first_frame;
  double start_us;                           // time of the batch's first known frame
  std::span<const IntervalTimes> intervals;  // one per plane from frame 2 on, and one more when the stream ends
  bool last;                                 // the last of `intervals` has no frame after it
  std::uint32_t first, count;
  std::span<const BackgroundEvent> background;  // by pixel; within these intervals
  EventSlots* events;
  ResetMark* marks;  // null: causes are not told
};

inline constexpr std::uint32_t kMaxLanes = 64;

void run_kernel(const KernelArguments& arguments);
// The same where there are thresholds alone: no photoreceptor, refractory period, leak, background or marks
// (threshold_kernel.cpp).
void run_threshold_kernel(const KernelArguments& arguments);

}  // namespace pecs::sensor
