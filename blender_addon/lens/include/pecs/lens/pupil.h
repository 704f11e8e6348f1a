#pragma once
// The pupil of the paper (Eq. 1): all directions from a film point that leave the lens. A direction is the point where
// it crosses the direction plane, the plane through the rear vertex.
#include <span>
#include <vector>

#include "pecs/lens/trace.h"

namespace pecs::lens {

// The pupil of the film point (r, 0, film_z): points (x, y) on the direction plane, symmetric in y.
struct ExactPupil {
  double r_mm = 0;
  double centre_x_mm = 0;              // inside, on y = 0
  std::vector<double> edge_mm;         // edge_mm[j]: distance from the centre to the edge at angle pi (j + 1/2) / size
  double area_mm2 = 0;                 // 0: no ray passes
  double irradiance_per_radiance = 0;  // E for scene radiance 1: integral of cos^4 / d^2 over the pupil [sr]
  Vec3 edge_point(std::size_t j) const;  // z = 0
};
ExactPupil exact_pupil(const Tracer& tracer, double film_z_mm, double r_mm, int angles = 180);

// Eq. 2: Elli(p, a, b), centre (p, 0), semi-axes a along the film point's radius and b across.
struct Ellipse {
  double p_mm = 0, a_mm = 0, b_mm = 0;
  double area_mm2() const;
};
Ellipse covering_ellipse(const ExactPupil& pupil);  // smallest ellipse that contains it

// The table the camera samples from: ellipses at evenly spaced film radii, interpolated linearly, enlarged by the
// margin so that the interpolated ellipse covers the exact pupil everywhere; exact areas at radii two or four times as
// dense.
struct PupilTable {
  double lambda_nm = 0, film_z_mm = 0, max_r_mm = 0;
  std::vector<Ellipse> ellipses;   // at max_r i / (size - 1)
  std::vector<double> areas_mm2;   // at max_r i / (size - 1)
  std::vector<double> irradiance;  // E per radiance [sr], at the radii of areas_mm2
  double missed_fraction = 0;      // the largest missed part of a pupil's area, found between the nodes
  double e0() const { return irradiance.front(); }
  Ellipse ellipse_at(double r_mm) const;
  double area_at(double r_mm) const;
};
PupilTable pupil_table(const Tracer& tracer, double film_z_mm, double max_r_mm);

// The pupils of a tilted film: its points have several z; by rotational symmetry, (r, z) determines a pupil. Tables at
// evenly spaced z, interpolated linearly; one table when the film is square to the axis.
struct PupilTables {
  std::vector<PupilTable> layers;  // at film_z + max_dz (2 k / (size - 1) - 1); one: at film_z
  double film_z_mm = 0, max_r_mm = 0, max_dz_mm = 0;
  double e0 = 0;               // on the axis at film_z, the film square to it [sr]
  double missed_fraction = 0;  // the largest missed part, found between radii and between layers
  Ellipse ellipse_at(double r_mm, double dz_mm = 0) const;
  double area_at(double r_mm, double dz_mm = 0) const;
};
PupilTables pupil_tables(const Tracer& tracer, double film_z_mm, double max_r_mm, double max_dz_mm);

// Part of the exact pupil's area outside the ellipse.
double missed_fraction(const ExactPupil& pupil, const Ellipse& ellipse);

}  // namespace pecs::lens
