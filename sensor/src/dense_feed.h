#pragma once
#include <span>
#include <vector>

#include "feed.h"
#include "pecs/sensor/motion.h"
#include "pecs/sensor/photocurrent.h"
#include "pecs/sensor/timeline.h"
#include "residuals.h"

namespace pecs::sensor {

// Photocurrent of whole pictures, at the source's instants and between them: carried along its motion, with its
// subpixels if it has some, so often that nothing moves more than half a pixel from plane to plane. The next interval
// is decoded while one is worked on, but not with subpixels, where two hold too much; a loop whose planes fit into
// memory is computed once. In the caller's TBB arena.
class DenseFeed : public Feed {
 public:
  DenseFeed(const Timeline& timeline, PhotocurrentReader& light);
  std::optional<Batch> next() override;
  std::int64_t steps() const override { return step_; }

 private:
  using Plane = std::vector<float>;
  // From a frame to the next one; its light with subpixels.
  struct Interval {
    Plane first, second;
    std::optional<Carrier> carrier;  // none behind the last frame
    std::vector<double> at{0.0};     // fractions of it to give planes of
    Residuals residuals;
  };
  // Of a loop, what is computed again and again: the planes of each frame's interval.
  struct Loop {
    struct Planes {
      std::vector<Plane> planes;
      std::vector<double> at;
    };
    std::vector<Planes> intervals;
    std::size_t bytes = 0;
    bool is_on = false, is_whole = false;
  };
  Plane read(std::int64_t step);
  void load(std::int64_t step, const Plane& first, Interval& interval);
  void load_between(std::int64_t step, const Plane& first, Interval& interval);
  void begin_interval();
  void average(const Plane& fine, Plane& plane) const;
  void carry(std::span<const double> fractions, std::span<Plane> planes);
  Batch part();
  Batch from_loop();
  void keep(const Batch& batch);
  double t_us(double fraction) const;

  const Timeline& timeline_;
  PhotocurrentReader& light_;
  std::size_t pixels_;
  std::vector<Plane> fine_;  // carried planes with their subpixels
  std::int64_t step_ = 0;
  std::size_t part_ = 0;  // planes given of the present interval
  Interval now_, soon_;
  std::vector<Plane> planes_of_part_;
  Loop loop_;
  bool is_ahead_ = true;  // the next interval is loaded while one is worked on
  Ahead ahead_;           // last: it goes first
};

}  // namespace pecs::sensor
