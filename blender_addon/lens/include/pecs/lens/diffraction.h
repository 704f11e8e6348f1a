#pragma once
// Diffraction at the stop, as a convolution of a band's picture with the far-field pattern of a round pupil.
#include <span>

namespace pecs::lens {

// MTF of a round pupil: (2/pi) (acos x - x sqrt(1 - x^2)), x = frequency * lambda * N (N the working f-number).
double diffraction_mtf(double cycles_per_mm, double lambda_nm, double working_fnumber);

// Radius of the first dark ring, 1.22 lambda N [mm].
double airy_radius_mm(double lambda_nm, double working_fnumber);

// Blurs a picture in place by multiplying its spectrum with that MTF. pixels: [height][width]. The picture is
// mirrored at its border, so that a uniform one stays uniform and no light is lost. Of a picture without negative
// pixels none becomes negative (rounding could make it so); of others, as differences of pictures are, all is kept.
// Throws std::invalid_argument for sizes that do not match.
void diffract(std::span<float> pixels, int width, int height, double pixel_pitch_mm, double lambda_nm,
              double working_fnumber);

}  // namespace pecs::lens
