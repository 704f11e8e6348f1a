#pragma once
// Frames in, sorted events out: a pixel model in parallel, and the order of its events.
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "pecs/events/event.h"
#include "pecs/sensor/pixel_model.h"
#include "pecs/sensor/readout.h"

namespace pecs::sensor {

// Sorts the events of a batch into the stream's order: time, then pixel. The order does not depend on how they came.
class EventSorter {
 public:
  // `causes`: events leave with their causes.
  explicit EventSorter(int width, bool causes = false) : width_(width), with_causes_(causes) {}
  // Events to come lie between these times; the better they are spread over them, the faster.
  void begin(std::span<const double> t_us);
  // To be filled; call for all before any is filled in parallel. Sorting is fastest when higher indices have higher
  // pixels.
  EventSlots& part(std::size_t index);
  // Appends the events before `until_us` to `out`, sorted, times less `origin_us`; keeps the others.
  void take(std::int64_t until_us, std::int64_t origin_us, LabelledEvents& out);

 private:
  int width_;
  bool with_causes_;
  std::vector<EventKey> edges_;  // of the slots
  std::vector<EventSlots> parts_;
  std::vector<EventKey> held_;
};

struct SensorExtras {
  bool readout = false;  // the chip's row arbiter and time base; else events leave as they come
  bool causes = false;   // of model pecs only
};

class Sensor {
 public:
  // gain_fa: photocurrent [fA] per unit of the planes' values. Throws bad_input, and usage for a wrong model.
  Sensor(const Chip& chip, int width, int height, std::uint64_t seed, double gain_fa, const ModelChoice& model = {},
         const SensorExtras& extras = {});
  int width() const { return width_; }
  int height() const { return height_; }

  // planes: [height * width] each, at rising times. Appends the events that are final; an interval's events come with
  // the second frame after it, or with `last`. Parallel over tiles, in the caller's TBB arena.
  // Throws bad_input for times that do not rise.
  void push(std::span<const float* const> planes, std::span<const double> t_us, bool last, LabelledEvents& out);
  std::int64_t dropped() const { return readout_ ? readout_->dropped() : 0; }

 private:
  int width_, height_;
  std::unique_ptr<PixelModel> model_;
  EventSorter order_;
  std::optional<Readout> readout_;
  LabelledEvents fired_;  // to be read out
  std::int64_t frames_ = 0;
  std::vector<double> recent_t_us_;  // of the last two frames
};

}  // namespace pecs::sensor
