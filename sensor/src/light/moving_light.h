#pragma once
// Light between the frames of a source: for the sensor's feed, for exposures and for frames that are pushed.
// Conventions: a plane is photocurrent [fA], row by row; a fraction s of an interval counts from its first frame (0) to
// its second (1). Keyframes have the source's subpixels; planes that are given to a caller are means over them.
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "pecs/sensor/motion.h"
#include "pecs/sensor/photocurrent.h"

namespace pecs::sensor {

using Plane = std::vector<float>;

// Corrections of warped light from pictures that were rendered between two keyframes (docs/reference/exr_stack.md,
// Pictures between instants).
class Residuals {
 public:
  // At the fraction s of the interval, rising from call to call: r = ln(rendered / warped) of the pixels that were
  // rendered, of light that a pixel can tell from darkness. 0 <= s <= 1; planes of one size.
  void add(double s, std::span<const float> rendered, std::span<const float> warped);
  // After the last add.
  void close();
  // Multiplies pixels [begin, end) of a warped plane by exp(r) at s: r is linear between the pictures in which the
  // pixel was rendered, and 0 at the keyframes, planes `first` and `second`. The light leaves the range of that in the
  // pictures before and after as far as the warped light leaves its own. In the caller's TBB arena.
  void apply(double s, const float* first, const float* second, float* warped, std::size_t begin,
             std::size_t end) const;
  // Those that were rendered, rising. After close().
  std::span<const std::uint32_t> pixels() const { return pixels_; }

 private:
  struct Residual {
    float s, r, warped;
  };
  struct Entry {
    std::uint32_t pixel;
    Residual residual;
  };
  std::vector<Entry> entries_;         // until close()
  std::vector<std::uint32_t> pixels_;  // with residuals, rising
  std::vector<std::uint32_t> first_;   // residual of each pixel, and the end
  std::vector<Residual> residuals_;    // by pixel, then s
};

// A frame's light on each chip, behind each of its filters.
struct Keyframe {
  std::int64_t frame = 0;
  std::vector<Plane> planes;
};

// Light from one frame to the next.
struct LightInterval {
  std::int64_t frame = 0;
  // Keyframes on each chip, behind each of its filters; no second: the first alone.
  std::vector<const float*> first{}, second{};
  std::optional<Carrier> carrier{};       // none: blended at the pixel
  std::optional<CarriedLight> carried{};  // by the carrier, of each plane of a keyframe
  std::vector<double> pictures{};         // fractions of the pictures rendered between
  std::vector<Residuals> residuals{};     // likewise, or none
  // Fractions at which a sensor takes planes: 0, then those along the motion (Carrier::instants),
  // and those of the pictures between in place of fractions close to them.
  std::vector<double> instants{0.0};
  std::shared_ptr<const Keyframe> owners[2] = {};  // of first and second, unless the caller holds them
};

// Computes planes of intervals, in memory that is used again. In the caller's TBB arena.
class MovingLight {
 public:
  // mosaics: of each chip, or null.
  MovingLight(int width, int height, int subpixels = 1, std::vector<const Mosaic*> mosaics = {nullptr});

  // sink(k, planes) gets planes [fraction][chip] of the fractions from the k-th on, a batch of at most kBatchBytes at a
  // time (but at least one fraction). They are valid until sink returns; rows outside `rows` are unspecified. Ends
  // early with false when sink returns false.
  using Sink = std::function<bool(std::size_t, std::span<const float* const>)>;
  bool planes(const LightInterval& interval, std::span<const double> fractions, Region rows, const Sink& sink);
  // Likewise all rows at all of the interval's instants. Parts in which nothing moves a quarter as far as elsewhere are
  // computed at every second, fourth or eighth of them, half as far apart in motion as the fastest ones and half of
  // Carrier::kStep_px at most, and interpolated between. Batches have at least as many fractions.
  bool along(const LightInterval& interval, const Sink& sink);
  static constexpr std::size_t kBatchBytes = std::size_t{32} << 20;

 private:
  // Parts of the picture that are computed at every 2^level-th instant, and the level of each.
  struct Levels {
    std::vector<Carrier::Part> parts;
    std::vector<std::size_t> of_part;
    std::size_t highest = 0;
    // Those that are computed at an instant.
    std::vector<Box> boxes(std::size_t level) const;
  };
  Levels levels_of(const LightInterval& interval) const;
  // Planes into these slots of planes_, in these boxes, which are counted in subpixels. fractions: of all slots from
  // the first on; 0 and 1 are the keyframes.
  void compute(const LightInterval& interval, std::span<const double> fractions, std::span<const std::size_t> slots,
               std::span<const Box> boxes, Region rows);
  // What `levels` leaves out of the slots from 1 to the one before the last. fractions: of the slots.
  void interpolate(const Levels& levels, std::span<const double> fractions);
  // Calls the sink with the slots from 0 on.
  bool give(std::size_t first, std::size_t slots, Region rows, const Sink& sink);
  void warp(const LightInterval& interval, std::span<const double> fractions, std::span<const Box> boxes, Region rows,
            std::span<float* const> out) const;
  void average(const float* fine, std::span<const Box> boxes, float* mean) const;
  // From the planes of filters, [fraction][chip][filter], to those of chips.
  void pick(Region rows, std::vector<const float*>& planes);

  std::vector<const Mosaic*> mosaics_;
  std::size_t width_, pixels_, side_, lights_;  // lights_: filters of all chips
  std::vector<Plane> planes_, fine_, picked_;
};

// Reads the intervals of a source. Keeps three keyframes and `kept` intervals, the newest. Not for two threads at once;
// in the caller's TBB arena.
class IntervalReader {
 public:
  // Light as each of the readers (of one source) computes it, along the source's motion or blended at the pixel.
  IntervalReader(const std::vector<PhotocurrentReader*>& chips, bool along_motion, std::size_t kept);
  // From a frame to the next one; with a period, from the last one to the first.
  std::shared_ptr<const LightInterval> interval(std::int64_t frame);
  // A frame alone.
  std::shared_ptr<const LightInterval> frame(std::int64_t frame);

 private:
  std::shared_ptr<const Keyframe> keyframe(std::int64_t frame);
  void add_motion(LightInterval& interval) const;
  double t_us(std::int64_t frame) const;
  const FrameSource& source() const { return lights_[0].chip->source(); }

  struct Light {
    PhotocurrentReader* chip;
    std::size_t filter;
  };
  std::vector<Light> lights_;  // planes of a keyframe
  bool along_motion_;
  std::size_t kept_;
  std::deque<std::shared_ptr<const Keyframe>> keyframes_;
  std::deque<std::shared_ptr<const LightInterval>> intervals_;
};

}  // namespace pecs::sensor
