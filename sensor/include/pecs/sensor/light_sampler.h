#pragma once
// The light of a source at any time: photocurrent at its frames and between them, as `pecs sense` computes it for the
// pixels, and its means over exposures.
// Conventions: t_us counts from the first frame, as events do; of a source with a period any later loop equals the
// first. Planes are amperes, without dark current, [chip][height][width]; a chip is given by its response to the
// bands (photocurrent.h).
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "pecs/sensor/photocurrent.h"

namespace pecs::sensor {

// Row y is exposed from begin_us + y * row_delay_us on, for exposure_us.
struct Exposure {
  double begin_us = 0, exposure_us = 0;
  double row_delay_us = 0;  // 0: all rows at once; negative: the last row comes first
  std::int64_t steps = 0;   // of an exposure; 0: as many as half a pixel of motion and pictures between frames need
};
inline constexpr std::int64_t kMostSteps = 1 << 16;
inline constexpr std::int64_t kMostCells = 1 << 20;  // of all rows together

// Holds the frames of two intervals, whatever times are asked for: cheapest for increasing times. Not for two threads
// at once; in the caller's TBB arena.
class LightSampler {
 public:
  // Along the source's motion, if it has that and `along_motion`; else frames are blended at the pixel, in ln. (The
  // sensor lays cubics through more frames there; the difference is of the order of that between frames.) The source
  // must outlive the sampler. Throws bad_input for no frames, and for a loop with missing frames.
  LightSampler(const FrameSource& source, std::span<const Response> chips, bool along_motion = true);
  ~LightSampler();

  std::size_t chips() const;
  std::size_t values() const;  // of the planes of one time
  bool along_motion() const;
  double end_us() const;  // the last frame's time; infinity with a period

  // out: [time][chip][height][width]. At a frame's time (to 0.5 ns) the frame itself. A pixel that is not finite there
  // is NaN; between two frames the one that is finite counts. Throws bad_input for a time outside the source's.
  void at(std::span<const double> t_us, std::span<float> out);

  // Mean of the light over each row's exposure. An exposure is cut into `steps` cells of equal length (with a row
  // delay, cells of that length from begin_us on, of which the first and the last count in part), in each of which the
  // light is that of its middle. Throws bad_input for no length, for times outside the source's, and for more than
  // kMostCells cells.
  void exposure(const Exposure& exposure, std::span<float> out);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace pecs::sensor
