#pragma once
// Units of times whose file does not state one: an option of each command and function that reads such times.
#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <optional>
#include <string>

#include "pecs/error.h"

namespace pecs {

enum class TimeUnit { ns = -3, us = 0, ms = 3, s = 6 };  // powers of ten in us
inline constexpr const char* kTimeUnits = "s, ms, us or ns";

inline TimeUnit time_unit_from(const std::string& name) {  // throws usage
  if (name == "s") return TimeUnit::s;
  if (name == "ms") return TimeUnit::ms;
  if (name == "us") return TimeUnit::us;
  if (name == "ns") return TimeUnit::ns;
  throw Error(ExitCode::usage, "time_unit: got " + printable(name) + ", wanted " + kTimeUnits);
}
inline const char* name_of(TimeUnit unit) {
  return unit == TimeUnit::s ? "s" : unit == TimeUnit::ms ? "ms" : unit == TimeUnit::us ? "us" : "ns";
}
// A whole number of `unit` in us, ns rounded half up; none beyond 64 bits.
inline std::optional<std::int64_t> to_us(std::int64_t value, TimeUnit unit) {
  if (unit == TimeUnit::ns) return value / 1000 + (value % 1000 + 1500) / 1000 - 1;
  std::int64_t us = 0;
  const std::int64_t factor = unit == TimeUnit::s ? 1'000'000 : unit == TimeUnit::ms ? 1000 : 1;
  if (__builtin_mul_overflow(value, factor, &us)) return {};
  return us;
}
// Words for errors that the option resolves.
inline constexpr const char* kStateTheUnit =
    "state the unit (--time-unit of sense, convert and info, in Python time_unit: s, ms, us or ns)";

// Times of frames in us whose unit is not stated. Throws bad_input for frames that are less than 1 us apart on
// average (seconds?), or of which four or more are all half a second or more apart (nanoseconds?).
class FrameUnitCheck {
 public:
  void add(double t_us) {
    if (frames_ > 0) least_us_ = std::fmin(least_us_, t_us - last_us_);
    if (frames_++ == 0) first_us_ = t_us;
    last_us_ = t_us;
  }
  void check(const std::string& source) const {
    if (frames_ < 2) return;
    const double mean_us = (last_us_ - first_us_) / static_cast<double>(frames_ - 1);
    if ((mean_us > 0 && mean_us < 1) || (frames_ >= 4 && least_us_ >= 5e5))
      throw bad_input(source, "t_us", fmt::format("{:.3g} between frames", mean_us),
                      fmt::format("microseconds, 1 or more and less than 500000 between frames; or {}", kStateTheUnit));
  }

 private:
  long long frames_ = 0;
  double first_us_ = 0, last_us_ = 0, least_us_ = INFINITY;
};

}  // namespace pecs
