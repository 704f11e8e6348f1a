#pragma once
// Frames of a rolling shutter, whose rows are exposed one after another, as those of a global one.
#include <memory>

#include "pecs/sensor/source.h"

namespace pecs::input {

// row_us: from a row to the next one. Each frame is warped to the time of its middle row, which is that of the frame:
// points move along the optical flow to the frame after it, or before it, by the time between their row and the middle.
std::unique_ptr<sensor::FrameSource> with_global_shutter(std::unique_ptr<sensor::FrameSource> frames, double row_us);

}  // namespace pecs::input
