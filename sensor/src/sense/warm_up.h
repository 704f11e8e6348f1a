#pragma once
// Light before the first frame: pixels that have been on for a while when the output begins.
#include <optional>
#include <vector>

#include "sense/feed.h"

namespace pecs::sensor {

// Takes the batches of a run in order, and passes them to `run`, after the light of `length_us` before them to
// `before`. That light has changed as it does from the first plane to the second, by at most kMostChange of ln I.
// Pixels take their direction from the first two planes, so these differ wherever the light will change. Batches may
// hold one plane: the first is then kept until the second is known.
class WarmUp {
 public:
  WarmUp(double length_us, std::size_t pixels, LightSink before, LightSink run)
      : length_us_(length_us), pixels_(pixels), before_(std::move(before)), run_(std::move(run)) {}
  bool operator()(const LightBatch& light);

 private:
  static constexpr float kMostChange = 0.5f;
  // One plane with its time, of the run's light and of the second reader's.
  struct Plane {
    double t_us;
    std::int64_t steps;
    std::vector<std::vector<float>> light;
  };
  Plane copy_of(const LightBatch& light, std::size_t plane) const;
  bool warm(const Plane& first, const Plane& second);

  double length_us_;
  std::size_t pixels_;
  LightSink before_, run_;
  std::optional<Plane> first_;
  bool is_warm_ = false;
};

}  // namespace pecs::sensor
