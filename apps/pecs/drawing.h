#pragma once
// SVG drawings in other forms: by librsvg, or, in a build without it (PECS_WITH_RSVG=OFF), not at all.
#include <string>

namespace pecs::app {

// One page; a unit of the viewBox is a millimetre. Throws Error(usage) in a build without librsvg.
std::string drawn_as_pdf(const std::string& svg);

// width_px wide, as high as the viewBox asks for. Throws as above.
std::string drawn_as_png(const std::string& svg, int width_px);

}  // namespace pecs::app
