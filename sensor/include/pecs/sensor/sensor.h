#pragma once
// The push interface: frames in, sorted events out.
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "pecs/events/format.h"
#include "pecs/sensor/event_sorter.h"
#include "pecs/sensor/pixel_model.h"
#include "pecs/sensor/readout.h"
#include "pecs/sensor/stages.h"

namespace pecs::sensor {

inline constexpr double kMostInterval_us = 1e9;  // between frames: within one, times have 32 bits in the kernels

// Converts frames as they are pushed to the batches of pixel models.
class FrameClock {
 public:
  // t_us: one per plane. Throws bad_input for times that do not rise, that rise by more than
  // kMostInterval_us, or that leave [0, kMostTime_us].
  FrameBatch batch(std::span<const float* const> planes, std::span<const double> t_us, bool last);
  void check(std::span<const double> t_us) const;  // throws as batch() does
  // Events before this time are complete: those of an interval are when the second frame after it, or `last`, is known.
  std::int64_t final_us() const { return final_us_; }
  double begin_us() const { return begin_us_; }  // time of the first frame

 private:
  std::int64_t frames_ = 0, final_us_ = 0;
  double begin_us_ = 0;
  std::vector<double> recent_t_us_;  // of the last two frames
};

// Runs a pixel model in the caller's TBB arena: tile by tile, in parallel, unless the model takes no tiles.
class PixelArray {
 public:
  PixelArray(const ModelChoice& choice, const Chip& chip, int width, int height, std::uint64_t seed, double unit_fa,
             bool causes);
  // For the pixels of a region: each region gets all batches, from the first.
  void advance(const FrameBatch& batch, PixelRange region, EventSorter& sorter);
  bool pixels_are_independent() const { return traits_.pixels_are_independent; }

 private:
  std::unique_ptr<PixelModel> model_;
  ModelTraits traits_;
};

struct SensorExtras {
  bool readout = false;  // the chip's row arbiter and time base; else events keep their times
  bool causes = false;   // report causes (models with tells_causes)
  bool noise = true;     // of the frames; that of the events is the chip's
  StageOptions stages = {};
};

class ChipFrames;

class Sensor {
 public:
  // unit_fa: photocurrent [fA] per unit of the planes' values. Throws bad_input, and usage for a wrong model.
  Sensor(const Chip& chip, int width, int height, std::uint64_t seed, double unit_fa, const ModelChoice& model = {},
         const SensorExtras& extras = {});
  ~Sensor();
  int width() const { return width_; }
  int height() const { return height_; }

  // planes: [height * width] each, at increasing times. Appends the events that are final; all of them with `last`: no
  // frame follows. Throws bad_input for times that do not increase, and then has consumed no frame.
  void push(std::span<const float* const> planes, std::span<const double> t_us, bool last, LabelledEvents& out);
  // The same with the motion of the interval before each plane, along which light between planes is warped: 2, 4 or 12
  // channels a plane, as Carrier takes them. The motion before the very first plane is ignored. Throws bad_input also
  // for another number of channels.
  void push_moving(std::span<const float* const> planes, std::span<const double> t_us, const float* motion,
                   std::size_t channels, bool last, LabelledEvents& events);
  // Frames that a chip with takes_frames completed since the last call, on the clock of the light; exposure k begins k
  // periods after the first light.
  std::vector<events::Frame> take_frames();
  std::int64_t dropped() const { return readout_ ? readout_->dropped() : 0; }
  const StageCounts& dropped_by_stage() const { return stages_.counts(); }

 private:
  std::size_t pixels() const { return static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_); }
  void advance(std::span<const float* const> planes, std::span<const double> t_us, bool last, LabelledEvents& out);

  int width_, height_;
  PixelArray pixels_;
  EventSorter sorter_;
  FrameClock clock_;
  std::optional<Readout> readout_;
  std::unique_ptr<ChipFrames> frames_;
  EventStages stages_;
  bool has_stages_;
  LabelledEvents fired_, sent_;  // by the pixels; by the readout
  std::vector<float> last_plane_;
  double last_t_us_ = 0;
};

}  // namespace pecs::sensor
