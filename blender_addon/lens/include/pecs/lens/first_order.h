#pragma once
// Gaussian optics at one wavelength, and focusing by real rays.
#include <optional>
#include <span>

#include "pecs/lens/trace.h"

namespace pecs::lens {

// Positions are z in the lens frame [mm]; lengths in mm. A pupil at infinity has an infinite position.
struct FirstOrder {
  double efl_mm, bfl_mm;
  double front_focus_z_mm, rear_focus_z_mm;
  double front_principal_z_mm, rear_principal_z_mm;
  double entrance_pupil_z_mm, entrance_pupil_diameter_mm;
  double exit_pupil_z_mm, exit_pupil_diameter_mm;
  double stop_diameter_mm;
  double fnumber;  // EFL / entrance pupil diameter
};

// Throws bad_input for a lens without a real image of a far object.
FirstOrder first_order(const Prescription& lens, double lambda_nm, double stop_diameter_mm = kWideOpen);

// The stop diameter that gives an f-number; throws bad_input beyond the widest aperture.
double stop_diameter_for_fnumber(const Prescription& lens, double fnumber, double lambda_nm = kLambdaD);

// Focus distances are measured along the axis from the entrance pupil's centre, the camera's origin;
// none = infinity.
struct Focus {
  std::optional<double> distance_m;
  double film_z_mm;
  double rms_spot_mm;  // on the axis, over all bands
};

// Unit focusing: the film distance with the least RMS spot of an axial object point over the bands (equal weights),
// by real rays evenly over the entrance pupil.
Focus best_focus(const Prescription& lens, std::span<const double> bands_nm, std::optional<double> distance_m,
                 double stop_diameter_mm = kWideOpen);

// A ray from the axial or far object point at `distance` towards (x, y) on the plane z = aim_z.
Ray ray_from_axis(std::optional<double> distance_m, double pupil_z_mm, double x_mm, double y_mm, double aim_z_mm);

}  // namespace pecs::lens
