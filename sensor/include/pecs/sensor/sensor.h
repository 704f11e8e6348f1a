#pragma once
// Frames in, sorted events out: a pixel model in parallel, and the order of its events.
#include <cstdint>
#include <span>
#include <vector>

#include "pecs/events/event.h"
#include "pecs/sensor/pixel_model.h"

namespace pecs::sensor {

// Sorts events that come by tile into the stream's order: time, then pixel. The order does not depend on the tiles.
class EventOrder {
 public:
  explicit EventOrder(int width) : width_(static_cast<std::uint32_t>(width)) {}
  std::vector<EventKey>& tile(std::size_t index);  // to be filled; call for all tiles before any is filled in parallel
  // Moves the events before `until_us` to `out`, sorted, times less `origin_us`; keeps the others.
  void take(std::int64_t until_us, std::int64_t origin_us, std::vector<events::Event>& out);

 private:
  std::uint32_t width_;
  std::vector<std::vector<EventKey>> tiles_;
  std::vector<EventKey> held_, sorted_;
};

class Sensor {
 public:
  // gain_fa: photocurrent [fA] per unit of the planes' values. Throws bad_input, and usage for a wrong model.
  Sensor(const Chip& chip, int width, int height, std::uint64_t seed, double gain_fa, const ModelChoice& model = {});
  int width() const { return width_; }
  int height() const { return height_; }

  // planes: [height * width] each, at rising times. Appends the events that are final; an interval's events come with
  // the second frame after it, or with `last`. Parallel over tiles, in the caller's TBB arena.
  // Throws bad_input for times that do not rise.
  void push(std::span<const float* const> planes, std::span<const double> t_us, bool last,
            std::vector<events::Event>& out);

 private:
  int width_, height_;
  std::unique_ptr<PixelModel> model_;
  EventOrder order_;
  std::int64_t frames_ = 0;
  std::vector<double> recent_t_us_;  // of the last two frames
};

}  // namespace pecs::sensor
