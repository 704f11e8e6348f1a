#pragma once
// Motion of pictures that come without it: dense optical flow from each frame to the next and back
// (docs/reference/sensor.md, Video).
#include <memory>

#include "pecs/sensor/source.h"

namespace pecs::input {

// A source's frames, and motion between them. The motion is 0 where nothing within kNear_px moves by kStill_px: there,
// light is that of the frames. Points that move more count as nearer. A point whose flow there and back does not
// return to it has no reliable motion: its pixels, along its path, are unsure. If hardly any point has, as at a cut of
// a film, nothing moves.
std::unique_ptr<sensor::FrameSource> with_estimated_motion(std::unique_ptr<sensor::FrameSource> frames);

}  // namespace pecs::input
