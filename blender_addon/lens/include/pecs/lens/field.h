#pragma once
// What the lens does off the axis: chief rays, fans.
#include <optional>
#include <vector>

#include "pecs/lens/pupil.h"

namespace pecs::lens {

// The ray that leaves the film point (r, 0, film_z) and crosses the stop's centre, traced to the scene, unclipped.
std::optional<Ray> chief_ray(const Tracer& tracer, std::size_t stop, double film_z_mm, double r_mm);

// The angle of the chief ray to the axis in the scene [degrees].
std::optional<double> field_angle_deg(const Tracer& tracer, std::size_t stop, double film_z_mm, double r_mm);

// Polylines for drawing, from the film point through the lens and `ahead` mm before the first vertex: `count` rays
// evenly over the pupil's meridional section. Empty when no ray gets through.
std::vector<std::vector<Vec3>> ray_fan(const Tracer& tracer, double film_z_mm, double r_mm, int count, double ahead_mm);

}  // namespace pecs::lens
