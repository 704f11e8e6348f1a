#pragma once
// Simulates frames from a camera or a video as they arrive: events to a file, and a view of them on the screen or,
// without a display, in a video.
#include "pecs/input/pictures.h"
#include "pecs/sensor/sense.h"

namespace pecs::input {

struct LiveOptions {
  std::optional<int> camera;         // its number; or
  std::filesystem::path file;        // a video
  std::optional<double> seconds;     // stop after this time
  std::int64_t picture_us = 33'333;  // events shown together
  std::filesystem::path video;       // written without a display
};

// sensor::sense() on live frames; all its options but `stack` apply. A camera's frames have their time of arrival, a
// video's frames the file's rate (or times.fps); the screen shows a video at most at that rate. Stops at the end, after
// `seconds` (required for a camera without a display), or with Escape in the window.
sensor::SenseReport sense_live(const LiveOptions& live, sensor::SenseOptions sense, const PictureOptions& pictures);

}  // namespace pecs::input
