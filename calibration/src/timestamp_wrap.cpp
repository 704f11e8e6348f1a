#include "pecs/calibration/timestamp_wrap.h"

#include <fmt/format.h>

#include "pecs/error.h"

namespace pecs::calibration {

events::Stream unwrap_timestamps(events::Stream stream, const std::string& file, std::string& note) {
  constexpr std::int64_t kDisorder_us = 10'000;
  std::int64_t added_us = 0, latest_us = INT64_MIN;
  for (std::size_t i = 0; i < stream.events.size(); ++i) {
    auto& e = stream.events[i];
    e.t_us += added_us;
    if (latest_us != INT64_MIN && e.t_us < latest_us - kDisorder_us) {
      // After a wrap the next timestamp is within a hundredth of the counter's range.
      std::int64_t range_us = 0;
      for (int bits = 16; bits <= 40 && range_us == 0; ++bits) {
        const std::int64_t range = std::int64_t{1} << bits, step = e.t_us + range - latest_us;
        if (step >= -kDisorder_us && step < std::max<std::int64_t>(range / 100, 1000)) range_us = range;
      }
      if (range_us == 0)
        throw bad_input(file, fmt::format("event {}", i),
                        fmt::format("a decrease from {} us to {} us", latest_us, e.t_us),
                        "increasing timestamps, or the wrap of a counter of 2^k us");
      e.t_us += range_us;
      added_us += range_us;
      note = fmt::format("the timestamps wrap after {} us (event {}); unwrapped", range_us, i);
    }
    latest_us = std::max(latest_us, e.t_us);
  }
  return stream;
}

}  // namespace pecs::calibration
