#pragma once
// Pictures of a lens as SVG text.
#include <optional>
#include <string>
#include <vector>

#include "pecs/lens/field.h"

namespace pecs::lens {

struct DrawOptions {
  std::vector<double> bands_nm{486.1, 587.6, 656.3};
  std::optional<double> focus_m;
  double stop_diameter_mm = kWideOpen;
  double film_half_diagonal_mm = 3.569;
  std::vector<double> fields{0.0, 0.7, 1.0};  // parts of the half diagonal
  int rays_per_fan = 5;
};

// The lens in section with its rays, to scale; scene left, film right.
std::string draw_svg(const Prescription& lens, const DrawOptions& options);

// One sheet: section, spot diagrams, relative illumination, distortion, lateral colour and MTF (geometric, and times
// the diffraction MTF of the working f-number) over film radius and frequency.
std::string chart_svg(const Prescription& lens, const DrawOptions& options);

// Exact pupils (filled) and covering ellipses at five film radii, on the direction plane, side by side.
std::string draw_pupils_svg(const Prescription& lens, double lambda_nm, double stop_diameter_mm, double film_z_mm,
                            double max_r_mm);

}  // namespace pecs::lens
