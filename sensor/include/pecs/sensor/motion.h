#pragma once
// Light between two keyframes, warped along the motion of the visible surfaces (docs/reference/sensor.md, Motion).
// Conventions: positions in pixels, x right, y down, pixel (x, y) has its centre at (x, y); an instant between
// the keyframes is their fraction s in [0, 1]. Start and end of an interval are its two keyframes.
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "pecs/sensor/source.h"

namespace pecs::sensor {

namespace motion {
struct PreparedLight;
}

// Channels of the layer `motion` (docs/reference/exr_stack.md): x_q1 y_q1 x_mid y_mid x_q3 y_q3 x_end y_end z z_end of
// the points visible at the start, then the same of those visible at the end, back to the start.
inline constexpr std::size_t kMotionChannels = 20;

// Throws bad_input unless there are 2, 4 or 20 values a pixel, as Carrier takes them.
void check_motion_size(std::size_t values, int width, int height);

// The layer's channels, of optical flow in 2 or 4 (see Carrier): points move evenly, those that move more count as
// nearer.
std::vector<float> motion_of_flow(std::span<const float> flow, std::size_t channels);

// Part of a picture: pixels [x0, x1) x [y0, y1).
struct Box {
  int x0 = 0, y0 = 0, x1 = kMaxSide, y1 = kMaxSide;
};

// Both keyframes, or one of them alone.
enum class CarrySide { both, first, second };

// The motion of one interval, prepared for any number of instants. Thread-safe; the result depends on neither the
// number of threads nor the order of calls.
class Carrier {
 public:
  // motion: [20][height][width], of the layer. Or [2]: forward optical flow, x and y [px] from the start; or [4]:
  // forward and backward flow; with flow, points that move more count as nearer. Values that are not finite are unknown
  // (a depth may be infinite). Throws bad_input for another size. In the caller's TBB arena.
  Carrier(std::span<const float> motion, int width, int height);
  // Motion of the interval that begins at a frame of a source with motion.
  Carrier(const FrameSource& source, std::int64_t frame);
  ~Carrier();
  Carrier(Carrier&&) noexcept;
  Carrier& operator=(Carrier&&) noexcept;

  // Longest path of a point within the interval [px], if it always moved as in its fastest quarter, clamped to the
  // picture's diagonal. 0: nothing moves.
  double longest_path_px() const;
  // Rising fractions in (0, 1), so that nothing moves more than about a step from one to the next. In an interval of
  // this length they are at least a microsecond apart. The distances vary at random by a quarter, other draw by draw:
  // errors of interpolation between planes do not recur at one frequency.
  static constexpr double kStep_px = 0.3, kStepOfEstimate_px = 1;
  std::vector<double> instants(double length_us, double step_px = kStep_px, std::int64_t draw = 0) const;

  // Parts of the picture, row by row, of one size but at the right and the lower border. Of each the longest path, as
  // above, of a point that may reach it; infinite where a motion is unknown.
  struct Part {
    Box box;
    float path_px;
  };
  std::vector<Part> parts() const;

  // Labels (object ids) at pixels and instants, from planes of labels at the start and at the end, [height * width]:
  // each sight gets the label of the point visible there, from the keyframe nearer in time if both show it. Labels are
  // never blended. If neither shows the point, or the motion is unknown, it is the label that both planes have at the
  // pixel, or 0. Sights sorted by fraction cost least. In the caller's TBB arena.
  struct Sight {
    std::int32_t pixel;  // y * width + x
    double fraction;
  };
  void labels(const std::int32_t* first, const std::int32_t* second, std::span<const Sight> sights,
              std::span<std::int32_t> out) const;

 private:
  friend class CarriedLight;
  struct KeyframeInterval;
  std::unique_ptr<KeyframeInterval> interval_;
};

// The light of both keyframes of an interval, each prepared for any number of instants at the first that needs it.
// Thread-safe.
class CarriedLight {
 public:
  // Planes of light at the start and at the end, each [height * width]. The caller keeps them, and the carrier's
  // motion (which may be moved from one Carrier to another).
  CarriedLight(const Carrier& carrier, std::span<const float* const> first, std::span<const float* const> second);
  ~CarriedLight();

  // Planes of light at fractions s, [fraction][plane]. One call for several costs less than several calls. s = 0 and
  // s = 1 give the keyframes; where nothing moves, equal values stay bit-identical. A point that both keyframes show is
  // blended in ln, with weight s of the second; a point that one keyframe shows is taken from it. Pixels whose point
  // neither shows, or whose motion is unknown, are blended in place; with one side they are NaN. Light that is not
  // finite counts as not visible. Outside the boxes planes are unspecified. In the caller's TBB arena.
  void planes(std::span<const double> fractions, std::span<float* const> out, std::span<const Box> boxes = kWhole,
              CarrySide side = CarrySide::both) const;
  static constexpr Box kWhole[] = {{}};

 private:
  const Carrier::KeyframeInterval& interval_;
  std::unique_ptr<motion::PreparedLight> light_;
};

}  // namespace pecs::sensor
