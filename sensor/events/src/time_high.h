#pragma once
// The high part of the time in RAW streams: it counts to `range`, then wraps to 0, and readers count the wraps they
// see.
#include <algorithm>
#include <cstdint>

namespace pecs::events {

class TimeHighReader {
 public:
  explicit TimeHighReader(std::int64_t range) : range_(range) {}
  bool known() const { return high_ >= 0; }  // events before the first TIME_HIGH have no time: decoders drop them
  std::int64_t value() const { return high_; }
  // A fall by half the range or more is a wrap; a smaller one is disorder in the stream and taken as it is.
  void take(std::int64_t value) {
    if (!known()) {
      high_ = value;
      return;
    }
    const std::int64_t wraps = high_ / range_ + (high_ % range_ >= value + range_ / 2 ? 1 : 0);
    high_ = wraps * range_ + value;
  }

 private:
  std::int64_t range_, high_ = -1;
};

// Calls put(value) for every TIME_HIGH to write on the way from `from` to `to`: steps of at most a quarter of the
// range, and over every wrap from its last value to 0, so that all readers count the same wraps however long the gap.
template <class Put>
void step_time_high(std::int64_t from, std::int64_t to, std::int64_t range, Put&& put) {
  while (from < to) {
    const std::int64_t last_of_wrap = from - from % range + range - 1;
    from = from == last_of_wrap ? from + 1 : std::min({from + range / 4, to, last_of_wrap});
    put(from);
  }
}

}  // namespace pecs::events
