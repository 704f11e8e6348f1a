#pragma once
// Colours from the bands of a stack.
#include <array>
#include <vector>

#include "pecs/sensor/bands.h"
#include "pecs/sensor/spectrum.h"

namespace pecs::view {

// Linear sRGB per unit of each band: colour = sum over bands of rgb[k] * value[k], up to one scale. White under the
// illuminant is neutral.
//
// Few bands are too coarse for a CIE sum, so the colour has two parts. First the reflectance in these bands under the
// illuminant, as a mixture of the three spectra of lens_data/spectra/basis/srgb.csv (least squares, exact for three
// bands); its coefficients are sRGB. Then the residual of that fit, by its CIE 1931 sum over the bands; for many bands
// this makes the sum exact, for three the residual is zero.
std::vector<std::array<double, 3>> rgb_of_bands(const std::vector<sensor::Band>& bands,
                                                const sensor::Spectrum& illuminant);

}  // namespace pecs::view
