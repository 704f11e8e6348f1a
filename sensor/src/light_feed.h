#pragma once
#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "feed.h"
#include "pecs/sensor/photocurrent.h"
#include "pecs/sensor/timeline.h"

namespace pecs::sensor {

// Photocurrent of a region in the order of time. The next batch is decoded while one is worked on; a loop that fits
// into memory is decoded once. In the caller's TBB arena.
class LightFeed : public Feed {
 public:
  LightFeed(const Timeline& timeline, PhotocurrentReader& light, Region region);
  std::optional<Batch> next() override;
  std::int64_t steps() const override { return step_; }

 private:
  using Planes = std::vector<std::vector<float>>;
  std::optional<Batch> next_live();
  void decode(std::int64_t first_step, std::int64_t end_step, Planes& planes);
  std::int64_t end_of_batch() const { return std::min(step_ + batch_, *timeline_.steps()); }

  const Timeline& timeline_;
  PhotocurrentReader& light_;
  Region region_;
  std::size_t pixels_;
  std::int64_t step_ = 0, batch_ = 1;
  bool is_cached_ = false, ended_ = false;
  int beyond_ = 0;                // live frames after the window
  std::array<Planes, 2> planes_;  // of this batch and of the next; cached: of all frames, in the first
  std::size_t half_ = 0;
  Ahead ahead_;  // last: it goes first
};

}  // namespace pecs::sensor
