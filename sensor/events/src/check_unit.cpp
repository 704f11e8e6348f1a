// Whether the times of a file that states no unit can be in the one that is assumed.
#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>

#include "codec.h"

namespace pecs::events {
namespace {

constexpr int kFirstEvents = 4096, kFewEvents = 20;
constexpr std::int64_t kMostTime_us = 100'000'000'000'000'000;  // 3,000 years: seconds since 1970 in ns exceed it
// Cameras' noise alone exceeds 100 Hz. A moving camera makes 10 to 35 events per second and pixel (docs/howto/cost.md);
// taken for microseconds, its nanoseconds make less than the second rate, quiet recordings seldom do.
constexpr double kLeastRate_hz = 100, kLeastPixelRate_hz = 0.04;

}  // namespace

void check_assumed_unit(Reader& reader, const std::filesystem::path& path, TimeUnit assumed) {
  // Converted times of a finer unit lie multiples of this apart, those of the unit itself hardly ever. A float of
  // seconds makes nanoseconds that are one short.
  const std::int64_t step_us = assumed == TimeUnit::s ? 1'000'000 : 1000, rounding_us = assumed == TimeUnit::s ? 0 : 1;
  std::int64_t first_us = 0, last_us = 0, events = 0, times = 0;
  int width = 0, height = 0;
  bool multiples = true, too_late = false, of_milliseconds = true;
  try {
    for (Event e; events < kFirstEvents && reader.read(std::span(&e, 1)) > 0; ++events) {
      if (events == 0) first_us = e.t_us;
      times += events == 0 || e.t_us != last_us;
      last_us = e.t_us;
      // Remainders, since the difference of wrong times may exceed 64 bits.
      const std::int64_t rest = std::abs(e.t_us % step_us - first_us % step_us) % step_us;
      multiples = multiples && std::min(rest, step_us - rest) <= rounding_us;
      of_milliseconds = of_milliseconds && e.t_us % 1000 == 0;
      too_late = too_late || e.t_us > kMostTime_us;
      width = std::max(width, e.x + 1);
      height = std::max(height, e.y + 1);
    }
  } catch (const Error&) {  // the reader itself reports it, after the events before it
  }
  const double seconds = 1e-6 * (static_cast<double>(last_us) - static_cast<double>(first_us));
  const double rate_hz = static_cast<double>(events) / seconds;
  const double least_hz = std::max(kLeastRate_hz, kLeastPixelRate_hz * width * height);
  // Seconds that resolve microseconds are seconds: no camera's milliseconds have six decimals.
  const bool is_finer = assumed == TimeUnit::s && !of_milliseconds;
  const bool too_slow = events >= kFewEvents && seconds > 0 && rate_hz < least_hz && !is_finer;
  if (!(multiples && times >= 3) && !too_slow && !too_late) return;
  const std::string unit = name_of(assumed);
  throw bad_input(path.string(), "times",
                  multiples && times >= 3 ? fmt::format("steps of {} {} alone", assumed == TimeUnit::s ? 1 : 1000, unit)
                  : too_late ? fmt::format("{} {}", last_us, unit)
                             : fmt::format("{:.3g} events per second of {}x{} pixels, if times are {}", rate_hz, width,
                                           height, unit),
                  fmt::format("times that can only be {}; {}", unit, kStateTheUnit));
}

}  // namespace pecs::events
