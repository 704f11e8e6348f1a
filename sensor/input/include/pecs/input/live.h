#pragma once
// Frames from a camera or a video as they come: events to a file, and a picture of them on the screen, or, where there
// is no display, in a video beside the file.
#include "pecs/input/pictures.h"
#include "pecs/sensor/sense.h"

namespace pecs::input {

struct LiveOptions {
  std::optional<int> camera;         // its number; else
  std::filesystem::path file;        // a video
  std::optional<double> seconds;     // stop after so long
  std::int64_t picture_us = 33'333;  // events shown together
  std::filesystem::path video;       // written where there is no display
};

// sensor::sense() on frames as they come; all its options but `stack` hold. A camera's frames have the time of their
// arrival, a video's frames the file's rate (or times.fps). On screen a video is not faster than that. Stops at the
// end, after `seconds` (needed for a camera without a display), or with Escape in the window.
sensor::SenseReport sense_live(const LiveOptions& live, sensor::SenseOptions sense, const PictureOptions& pictures);

}  // namespace pecs::input
