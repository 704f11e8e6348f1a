#pragma once
// Inputs of networks: the events of a window as planes of float, row 0 at the top. Each function fills all of `out`, in
// one thread; equal events give equal bits. Events before begin_us or after end_us are ignored; their order affects
// rounding only. All throw bad_input for a pixel outside the sensor (then `out` is unspecified), and usage errors for a
// wrong size.
#include <span>

#include "pecs/events/event.h"

namespace pecs::events {

struct EventWindow {
  int width = 0, height = 0;
  double begin_us = 0, end_us = 0;
};

// Voxel grid, bilinear in time, out[bins][height][width]: bin b is the sum over events of (p ? 1 : -1) *
// max(0, 1 - |b - t*|), t* = (bins - 1) (t - begin_us) / (end_us - begin_us); t* = 0 in a window without length.
// Zhu et al., CVPR 2019, eq. 1 to 3, as E2VID takes it (Rebecq et al., TPAMI 2021, sec. 3.2).
// normalise: the values that are not 0 get mean 0 and standard deviation 1 (only the mean if they are all the same), as
// E2VID's network expects them.
void voxel_grid(std::span<const Event> events, const EventWindow& window, int bins, bool normalise,
                std::span<float> out);

// Time surface, out[2][height][width], OFF and ON: exp(-(end_us - t) / tau_us) of the pixel's last event of that
// polarity, 0 without one. Lagorce et al., HOTS, TPAMI 2017, eq. 3.
void time_surface(std::span<const Event> events, const EventWindow& window, double tau_us, std::span<float> out);

// Counts, out[2 * bins][height][width]: all bins of OFF, then all of ON; bin floor(bins (t - begin_us) / (end_us -
// begin_us)), the window's end in the last. As RVT's stacked histograms (Gehrig & Scaramuzza, CVPR 2023), not cut off.
void event_histogram(std::span<const Event> events, const EventWindow& window, int bins, std::span<float> out);

}  // namespace pecs::events
