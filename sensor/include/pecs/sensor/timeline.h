#pragma once
// The order and times of frames, as far as the output's window needs them: a source's frames once, those of a periodic
// stack in loops.
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "pecs/sensor/source.h"

namespace pecs::sensor {

inline constexpr std::int64_t kLongestWarmup_us = 10'000'000;

struct Window {
  int warmup_loops = 0;                     // of a periodic stack, before the output begins
  std::int64_t warmup_us = 0;               // light before the first frame, extrapolated; not of a periodic stack
  std::int64_t start_us = 0;                // the output begins this long after the warm-up (or the first frame)
  std::optional<std::int64_t> duration_us;  // none: the period, or to the last frame
};

// Most photocurrents of a loop that are held in memory. A larger loop is simulated band by band of rows.
inline constexpr std::size_t kLoopBytes = std::size_t{128} << 20;

class Timeline {
 public:
  // Throws bad_input for loops of a source without a period, and for a window that begins beyond the source's end.
  Timeline(FrameSource& source, const Window& window);

  bool loops() const { return period_us_ > 0; }
  // When the readout begins: events of a warm-up are not read.
  std::int64_t read_out_from_us() const { return read_out_from_us_; }
  std::int64_t warmup_us() const { return warmup_us_; }
  // Frames in the order of time: how many are needed, which one, when.
  std::int64_t steps() const { return steps_; }
  std::int64_t frame(std::int64_t step) const { return step % source_.frames(); }
  double t_us(std::int64_t step) const;
  // The output's window on the same clock.
  std::int64_t from_us() const { return from_us_; }
  std::int64_t to_us() const { return to_us_; }

  // For a window that ends beyond the source's end.
  std::vector<std::string> warnings() const { return warnings_; }

  FrameSource& source() const { return source_; }
  // The whole picture; or, for a loop with independent pixels, bands of rows whose frames fit into kLoopBytes.
  std::vector<Region> regions(bool pixels_are_independent) const;

 private:
  FrameSource& source_;
  double period_us_ = 0;  // of a loop
  std::int64_t steps_ = 0;
  std::int64_t from_us_ = 0, to_us_ = 0, warmup_us_ = 0, read_out_from_us_ = 0;
  std::vector<std::string> warnings_;
};

}  // namespace pecs::sensor
