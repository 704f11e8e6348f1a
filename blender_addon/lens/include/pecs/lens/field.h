#pragma once
// The lens off the axis: chief rays, fans, spots, MTF.
#include <optional>
#include <vector>

#include "pecs/lens/first_order.h"
#include "pecs/lens/pupil.h"

namespace pecs::lens {

// The ray that leaves the film point (r, 0, film_z) and crosses the stop's centre, traced to the scene, unclipped.
std::optional<Ray> chief_ray(const Tracer& tracer, std::size_t stop, double film_z_mm, double r_mm);

// The angle of the chief ray to the axis in the scene [degrees].
std::optional<double> field_angle_deg(const Tracer& tracer, std::size_t stop, double film_z_mm, double r_mm);

// Polylines for drawing, from the film point through the lens and `ahead` mm before the first vertex: `count` rays
// evenly over the pupil's meridional section. Empty if no ray passes.
std::vector<std::vector<Vec3>> ray_fan(const Tracer& tracer, std::size_t stop, double film_z_mm, double r_mm, int count,
                                       double ahead_mm);

// Spot of one object point: the point imaged at (r, 0) by the chief ray at the reference wavelength.
struct ObjectPoint {
  bool at_infinity = true;
  Vec3 place;  // the point, or the unit direction of its light (d.z > 0)
  Ray towards(double x_mm, double y_mm, double z_mm) const;
};
std::optional<ObjectPoint> object_point(const Tracer& reference, std::size_t stop, const Focus& focus,
                                        double pupil_z_mm, double r_mm);

// Hits on the film of rays evenly over the part of the entrance pupil that passes, `across` of them in its diameter.
std::vector<Vec3> spot(const Tracer& tracer, const Tracer& reference, const ObjectPoint& object, const Focus& focus,
                       double pupil_z_mm, double r_mm, int across);
double rms_radius_mm(const std::vector<Vec3>& hits);

// Geometric MTF of a spot at a frequency, for bars across the radius (tangential) and along it (sagittal).
struct Mtf {
  double tangential, sagittal;
};
Mtf geometric_mtf(const std::vector<Vec3>& hits, double cycles_per_mm);

// MTF with diffraction, at evenly spaced frequencies from 0: the autocorrelation of the pupil function
// A exp(2 pi i W / lambda) over the direction cosines at the film point (r, 0), W by the optical paths of real rays
// from it to the object point (reversed light), A = 1 where they pass.
struct MtfCurve {
  std::vector<double> cycles_per_mm, tangential, sagittal;
};
MtfCurve wavefront_mtf(const Prescription& lens, const Tracer& tracer, const ObjectPoint& object, const Focus& focus,
                       double r_mm, double max_cycles_per_mm);

// Aberrations over the film radius.
struct FieldRow {
  double r_mm, angle_deg;  // of the chief ray in the scene
  double relative_illumination;
  double distortion_percent;              // against r = k tan(angle), k from the axis
  std::vector<double> lateral_colour_um;  // per band: its chief ray's radius minus the reference's, same object point
  std::vector<double> rms_spot_um;        // per band, about its own centroid
};
std::vector<FieldRow> field_rows(const Prescription& lens, const std::vector<double>& bands_nm, double reference_nm,
                                 double stop_diameter_mm, const Focus& focus, double max_r_mm, int rows);

}  // namespace pecs::lens
