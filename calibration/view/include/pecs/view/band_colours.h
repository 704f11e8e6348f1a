#pragma once
// A stack's bands as colours.
#include <array>
#include <vector>

#include "pecs/sensor/bands.h"
#include "pecs/sensor/spectrum.h"

namespace pecs::view {

// Linear sRGB per unit of each band: colour = sum over bands of rgb[k] * value[k], up to one scale. White under the
// illuminant is neutral.
//
// A few bands do not make a CIE sum, so the colour is taken in two parts. First the reflectance that these bands have
// under the illuminant, as a mixture of the three of lens_data/spectra/basis/srgb.csv (least squares, exact for three
// bands): the mixture's parts are its sRGB. Then what the mixture misses, by its CIE 1931 sum over the bands; of many
// bands this makes the sum exact, of three nothing is left.
std::vector<std::array<double, 3>> rgb_of_bands(const std::vector<sensor::Band>& bands,
                                                const sensor::Spectrum& illuminant);

}  // namespace pecs::view
