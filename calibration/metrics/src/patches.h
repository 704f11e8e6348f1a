#pragma once
// Features of patches of a recording (realism.h).
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "pecs/events/event.h"

namespace pecs::metrics {

// Features of one group stand together; the first one is the quantity that is printed.
struct CueGroup {
  const char *name, *quantity, *values;
  int first, count;
  bool log10;  // the quantity is a logarithm
};
inline constexpr int kFeatures = 46;
inline constexpr std::array<CueGroup, 8> kCueGroups{{
    {"rate", "events per patch", "light, contrast, contrast_threshold_on and _off", 0, 1, true},
    {"clock", "share of equal time stamps", "readout, timestamp_s, the frames' times", 1, 1, false},
    {"hot pixels", "share of events of hot pixels", "hot_pixel_fraction, hot_pixel_hz", 2, 2, false},
    {"pixels", "covariance of a pixel's relative excess in two times", "threshold_mismatch", 4, 1, false},
    {"noise", "share of isolated events", "background_on_hz and _off, noise_std", 5, 2, false},
    {"polarity", "share of ON events", "contrast_threshold_on against contrast_threshold_off", 7, 2, false},
    {"intervals", "us between events of a pixel (none: 1 s)", "corner_hz_per_a or the light, refractory_period_s", 9,
     21, true},
    {"neighbours", "us since the last event of a neighbour", "corner_hz_per_a or the light, noise_std", 30, 16, true},
}};

struct Patch {
  std::uint32_t block;  // row * columns + column
  int fold;             // 2 * half of the time + colour of the chequered sensor
  std::array<float, kFeatures> values;
};

// The patches of events in time order within [0, end_us). Cues of time, but not that of the clock, see times in
// multiples of tick_us.
std::vector<Patch> patches_of(std::span<const events::Event> events, int width, int height, std::int64_t end_us,
                              std::int64_t tick_us);

}  // namespace pecs::metrics
