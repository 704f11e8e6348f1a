#pragma once
// Light between two keyframes, carried along the motion of the surfaces that are seen (docs/reference/sensor.md,
// Motion). Conventions: positions in pixels, x right, y down, pixel (x, y) has its centre at (x, y); an instant between
// the keyframes is their fraction s in [0, 1]. Start and end of an interval are its two keyframes.
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "pecs/sensor/source.h"

namespace pecs::sensor {

// Channels of the layer `motion` (docs/reference/exr_stack.md): x_mid y_mid x_end y_end z z_end of the points seen at
// the start, then the same of those seen at the end, back to the start.
inline constexpr std::size_t kMotionChannels = 12;

// Throws bad_input unless there are 2, 4 or 12 values a pixel, as Carrier takes them.
void check_motion_size(std::size_t values, int width, int height);

// Both keyframes, or one of them alone.
enum class CarrySide { both, first, second };

// The motion of one interval, prepared for any number of instants. May be used by many threads; the result depends on
// neither their number nor the order of calls.
class Carrier {
 public:
  // motion: [12][height][width], of the layer. Or [2]: forward optical flow alone, x and y [px] from the start; or [4]:
  // forward and backward flow; what moves more then counts as nearer. What is not finite is not known (a depth may be
  // infinite). Throws bad_input for another size. In the caller's TBB arena.
  Carrier(std::span<const float> motion, int width, int height);
  // Of the interval that begins at a frame of a source with motion.
  Carrier(const FrameSource& source, std::int64_t frame);
  ~Carrier();
  Carrier(Carrier&&) noexcept;
  Carrier& operator=(Carrier&&) noexcept;

  // No point's path within the interval is longer [px], as far as the picture is wide and high. 0: nothing moves.
  double longest_path_px() const;
  // Fractions in (0, 1), evenly spaced, between which nothing moves more than half a pixel (of so many subpixels), nor
  // less than a microsecond passes in an interval of this length.
  std::vector<double> instants(double length_us, int subpixels = 1) const;

  // Planes of light at fractions s, [fraction][plane], from those at the start and at the end; each [height * width].
  // Together they cost less than one by one. s = 0 and s = 1 give the keyframes; equal values that nothing moves over
  // stay as they are. Where both keyframes show a point they are blended in ln, s being the weight of the second; where
  // one shows it that one counts; where none does, or the motion is not known, both are blended at the pixel itself.
  // With one side alone such pixels are NaN. Light that is not finite counts as not seen. Of rows that no one wants
  // (all but `rows`) the values are any. In the caller's TBB arena.
  void planes(std::span<const float* const> first, std::span<const float* const> second,
              std::span<const double> fractions, std::span<float* const> out, CarrySide side = CarrySide::both,
              Region rows = {0, kMaxSide}) const;
  void plane(const float* first, const float* second, double s, float* out) const {
    planes({&first, 1}, {&second, 1}, {&s, 1}, {&out, 1});
  }

  // Numbers of what is seen (object ids), from planes of them at the start and at the end, [height * width]: for each
  // sight that of the point which is visible there and then, of the keyframe nearer in time if both show it, never
  // blended. Where none shows it, or the motion is not known: what both planes have at the pixel, or 0. Sights with one
  // fraction after the other cost least. In the caller's TBB arena.
  struct Sight {
    std::int32_t pixel;  // y * width + x
    double fraction;
  };
  void labels(const std::int32_t* first, const std::int32_t* second, std::span<const Sight> sights,
              std::span<std::int32_t> out) const;

 private:
  struct Interval;
  std::unique_ptr<Interval> interval_;
};

}  // namespace pecs::sensor
