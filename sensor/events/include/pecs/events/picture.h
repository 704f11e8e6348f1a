#pragma once
// Events as a picture. ON is blue and OFF is orange, which colour-blind people can distinguish (Okabe and Ito, 2008);
// pixels without events have the paper's colour.
#include <span>
#include <string>
#include <vector>

#include "pecs/events/event.h"

namespace pecs::events {

struct Rgb {
  std::uint8_t r, g, b;
  std::string hex() const;  // "#0072b2"
};

struct Theme {
  Rgb paper, ink, on, off;
};
inline constexpr Theme kLight{{255, 255, 255}, {27, 31, 36}, {0, 114, 178}, {213, 94, 0}};
inline constexpr Theme kDark{{20, 23, 27}, {232, 235, 238}, {86, 180, 233}, {240, 140, 40}};
const Theme& theme_of(const std::string& name);  // "light" or "dark"

// Row 0 at the top. The hue mixes a cell's polarities, the saturation grows with their number: one event 0.7, two 0.91.
// A cell is `binning` x `binning` pixels. Throws bad_input for an event outside of the sensor.
std::vector<Rgb> picture(std::span<const Event> events, int width, int height, const Theme& theme, int binning = 1);

}  // namespace pecs::events
