#pragma once
// A simulation whose events are shown as they come: on the screen or, without a display, in a video.
#include "pecs/sensor/sense.h"

namespace pecs::input {

struct Screen {
  std::int64_t picture_us = 33'333;  // events shown together
  std::filesystem::path video;       // written without a display
};

// sensor::sense() with `options.source`. The screen shows at most one second of events a second. Stops at the end, or
// with Escape in the window.
sensor::SenseReport sense_on_screen(const Screen& screen, sensor::SenseOptions options);

}  // namespace pecs::input
