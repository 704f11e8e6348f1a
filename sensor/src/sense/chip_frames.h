#pragma once
// Frames that the chip takes of its pixels' own photocurrent (docs/reference/sensor.md#frames-of-a-davis).
// The exposure of frame k begins k periods after the first light; row y is exposed y * frame_row_s later. Light between
// two planes is linear in time, so planes that follow the motion blur an edge as the exposure does. An automatic
// exposure is that of davis_ros_driver (github.com/uzh-rpg/rpg_dvs_ros) or of libcaer (github.com/inivation/libcaer):
// each frame changes the one after it.
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "pecs/events/format.h"
#include "pecs/sensor/chip.h"
#include "pecs/sensor/pixel_model.h"
#include "pecs/sensor/source.h"
#include "pecs/strict_json.h"

namespace pecs::sensor {

class ChipFrames {
 public:
  // Frames whose exposure lies inside [from_us, to_us), on the clock of the light. unit_fa: photocurrent per unit of
  // the light. seed: none without noise.
  ChipFrames(const Chip& chip, int width, int height, double unit_fa, std::optional<std::uint64_t> seed,
             std::int64_t from_us = 0, std::int64_t to_us = INT64_MAX);

  // Light of the rows, indexed by the pixel in the whole picture; starts again with the first time of other rows.
  void add(std::span<const float* const> planes, std::span<const double> t_us, Region rows);
  // Exposures that some row has in [from_us, to_us], as far as the light so far.
  std::vector<ChipExposure> exposures(double from_us, double to_us);
  // The frames that the light so far completes, in order, with times from `from_us`.
  std::vector<events::Frame> take() { return std::exchange(complete_, {}); }

  Json report() const;
  std::vector<std::string> warnings() const;  // of pixels that saturate

 private:
  struct Metered {
    double end_us, exposure_us, factor, add_us;  // what it does to the next exposure
  };
  void expose(const float* from, const float* to, double from_us, double to_us);
  void complete(std::int64_t frame);
  events::Frame developed(std::int64_t frame, std::span<const double> light);
  double exposure_us(std::int64_t frame);
  double begin_us(std::int64_t frame) const { return static_cast<double>(frame) * period_us_; }
  double end_us(std::int64_t frame) { return begin_us(frame) + exposure_us(frame) + rolled_us_; }  // of the last row
  std::int64_t first_frame(double us) const;  // that some row may have then
  bool is_output(std::int64_t frame) { return begin_us(frame) >= from_us_ && end_us(frame) <= to_us_; }

  Chip chip_;
  std::size_t width_, height_;
  double unit_fa_;
  std::optional<std::uint64_t> seed_;
  double from_us_, to_us_, period_us_, row_us_, rolled_us_;
  std::vector<double> exposures_us_;  // of the first frames; without automatic exposure, of the first one alone
  bool libcaer_;                      // whose automatic exposure
  double most_us_;                    // of an automatic exposure
  std::deque<Metered> metered_;       // frames that no exposure follows yet
  Region rows_{};
  std::vector<float> last_plane_, plane_;  // of the rows
  double last_us_ = 0;
  std::map<std::int64_t, std::vector<double>> light_;  // [units us] of frames that are not complete
  std::vector<events::Frame> complete_;                // not taken
  std::int64_t frames_ = 0, saturated_ = 0;
  double sum_ = 0;  // of all values
};

}  // namespace pecs::sensor
