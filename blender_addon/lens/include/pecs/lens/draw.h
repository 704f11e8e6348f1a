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

}  // namespace pecs::lens
