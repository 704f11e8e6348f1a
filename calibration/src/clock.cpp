#include "pecs/calibration/clock.h"

#include <fmt/format.h>

#include "pecs/error.h"

namespace pecs::calibration {

events::Stream with_steady_clock(events::Stream stream, const std::string& file, std::string& note) {
  constexpr std::int64_t kDisorder_us = 10'000;
  std::int64_t added_us = 0, latest_us = INT64_MIN;
  for (std::size_t i = 0; i < stream.events.size(); ++i) {
    auto& e = stream.events[i];
    e.t_us += added_us;
    if (latest_us != INT64_MIN && e.t_us < latest_us - kDisorder_us) {
      // After a wrap the clock goes on within a hundredth of the counter's range.
      std::int64_t range_us = 0;
      for (int bits = 16; bits <= 40 && range_us == 0; ++bits) {
        const std::int64_t range = std::int64_t{1} << bits, step = e.t_us + range - latest_us;
        if (step >= -kDisorder_us && step < std::max<std::int64_t>(range / 100, 1000)) range_us = range;
      }
      if (range_us == 0)
        throw bad_input(file, fmt::format("event {}", i),
                        fmt::format("time goes back from {} us to {} us", latest_us, e.t_us),
                        "a clock that goes on, or a counter that starts again");
      e.t_us += range_us;
      added_us += range_us;
      note = fmt::format("the clock starts again after {} us (event {}); continued", range_us, i);
    }
    latest_us = std::max(latest_us, e.t_us);
  }
  return stream;
}

}  // namespace pecs::calibration
