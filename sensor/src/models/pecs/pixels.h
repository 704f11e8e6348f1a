#pragma once
// The pixel model `pecs` (docs/reference/sensor.md): photocurrent planes in, event keys out. Every pixel has its own
// thresholds and state; any thread may advance a range of pixels.
//
// The interval that starts at frame k is processed when frame k + 2 is known, because its cubic (cubic.h) needs the
// slope at frame k + 1.
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "models/entry.h"
#include "pecs/sensor/random.h"
#include "pixels/zeros.h"

namespace pecs::sensor {

// A noise event, independent of the light.
struct BackgroundEvent {
  double t_us;
  std::uint32_t pixel;
  bool on;
  Cause cause = Cause::noise;
};

struct HotPixel {
  std::uint32_t pixel;
  double hz;
};

// Time and noise at a pixel's last reset, for the causes of events. phase: distance from the reference then, not 0
// only for pixels that begin at a random one. step, slow: by an exposure at step_us, where the output was `output`; 0
// before the first one after the reset.
struct ResetMark {
  double t_us = 0;
  float noise = 0, phase = 0;
  double step_us = 0;
  float step = 0, slow = 0, output = 0;
};

// The begin or end of an exposure of the chip's frames, in row 0.
struct ExposureStep {
  double t_us;
  std::int64_t frame;
  bool ends;
};
struct ExposureSteps {
  std::span<const ExposureStep> steps;  // by time
  double row_us = 0;                    // delay from row to row
  std::uint32_t width = 1;
  double step = 0, spread = 0;   // of y [ln units]: median; standard deviation of its logarithm
  double slow = 0, slow_us = 1;  // of all that the comparators see; its time constant
};

struct PixelConstants {
  double a_per_us = 0;  // 2 pi * corner per fA and us; 0: V = ln I
  double b_per_us = 0;  // 2 pi * cutoff of the amplifier per us; 0: none
  double leak_per_us = 0;
  double refractory_us = 0;
};

class PecsPixels : public PixelModel {
 public:
  explicit PecsPixels(const ModelSetup& setup);
  void advance(const FrameBatch& batch, PixelRange range, EventSlots& events) override;

 private:
  bool has_due_events() const { return has_background() || takes_frames_; }
  bool has_background() const {
    return background_on_hz_ + background_off_hz_ > 0 || !hot_.empty() || maps_background();
  }
  bool maps_background() const { return map_ && !map_->background_on_hz.empty(); }
  bool maps_thresholds() const { return map_ && !map_->threshold_on.empty(); }
  bool has_thresholds_only() const;
  void draw_thresholds(const Chip& chip, std::size_t pixels);
  void place_hot_pixels(const Chip& chip, int height);
  Random4 random_of(std::uint32_t pixel) const;
  std::optional<std::size_t> mapped(std::uint32_t pixel) const;  // index of its values in the map
  std::vector<BackgroundEvent> background(double begin_us, double end_us, PixelRange range) const;

  PixelConstants constants_;
  double dark_fa_, gain_fa_, noise_std_, background_on_hz_, background_off_hz_;
  std::uint64_t seed_, noise_seed_;
  bool random_phase_;
  bool equal_thresholds_;
  bool takes_frames_;
  ExposureSteps exposures_;             // without the steps
  Zeros threshold_on_, threshold_off_;  // if equal, one vector each
  Zeros light0_, light1_;               // of the last two frames (kernel.h)
  Zeros m0_;                            // slope of ln I [1/us] at the earlier one
  Zeros reference_, blind_us_;          // blind_us_: empty with thresholds only
  Zeros w_;                             // photoreceptor; empty when infinitely fast
  Zeros y_, n_, z_, e_;                 // as in kernel.h; empty without
  std::vector<HotPixel> hot_;           // sorted
  std::shared_ptr<const PixelMap> map_;
  std::uint32_t width_;
  std::vector<ResetMark> marks_;  // empty without causes, and with thresholds only
};

}  // namespace pecs::sensor
