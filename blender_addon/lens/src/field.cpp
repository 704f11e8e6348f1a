#include "pecs/lens/field.h"

#include <cmath>
#include <numbers>

namespace pecs::lens {
namespace {

Ray towards(double r, double film_z, double x, double plane_z) {
  const Vec3 film{r, 0, film_z};
  return {film, normalized(Vec3{x, 0, plane_z} - film)};
}

}  // namespace

std::optional<Ray> chief_ray(const Tracer& tracer, std::size_t stop, double film_z_mm, double r_mm) {
  const double plane = tracer.rear_z_mm();
  std::vector<Vec3> hits;
  // Height in the stop of the ray through x on the direction plane; NaN where it does not arrive.
  const auto height = [&](double x) {
    hits.clear();
    tracer.to_scene(towards(r_mm, film_z_mm, x, plane), Tracer::Clip::none, &hits);
    const std::size_t needed = tracer.surface_count() - stop;
    return hits.size() >= needed ? hits[needed - 1].x : std::nan("");
  };
  const ExactPupil pupil = exact_pupil(tracer, film_z_mm, r_mm, 4);
  double x0 = pupil.centre_x_mm, x1 = x0 + 1e-3 * tracer.rear_semi_diameter_mm();
  double h0 = height(x0), h1 = height(x1);
  for (int i = 0; i < 60 && std::isfinite(h1) && h1 != h0 && std::abs(h1) > 1e-12; ++i) {
    const double x = x1 - h1 * (x1 - x0) / (h1 - h0);
    x0 = x1;
    h0 = h1;
    x1 = x;
    h1 = height(x);
  }
  if (!(std::abs(h1) < 1e-9)) return std::nullopt;
  const Traced traced = tracer.to_scene(towards(r_mm, film_z_mm, x1, plane), Tracer::Clip::none);
  if (traced.fate != Fate::ok) return std::nullopt;
  return traced.ray;
}

std::optional<double> field_angle_deg(const Tracer& tracer, std::size_t stop, double film_z_mm, double r_mm) {
  const auto ray = chief_ray(tracer, stop, film_z_mm, r_mm);
  if (!ray) return std::nullopt;
  return std::atan2(std::abs(ray->d.x), -ray->d.z) * 180.0 / std::numbers::pi;
}

std::vector<std::vector<Vec3>> ray_fan(const Tracer& tracer, double film_z_mm, double r_mm, int count,
                                       double ahead_mm) {
  std::vector<std::vector<Vec3>> fan;
  const ExactPupil pupil = exact_pupil(tracer, film_z_mm, r_mm, 180);
  if (pupil.area_mm2 <= 0) return fan;
  const double right = pupil.edge_point(0).x, left = pupil.edge_point(pupil.edge_mm.size() - 1).x;
  for (int i = 0; i < count; ++i) {
    const double part = count == 1 ? 0.5 : 0.001 + 0.998 * i / (count - 1.0);
    std::vector<Vec3> line{{r_mm, 0, film_z_mm}};
    const Traced traced = tracer.to_scene(towards(r_mm, film_z_mm, left + part * (right - left), tracer.rear_z_mm()),
                                          Tracer::Clip::housing, &line);
    if (traced.fate != Fate::ok) continue;
    line.push_back(traced.ray.at_z(std::min(-ahead_mm, traced.ray.p.z - 1e-3)));
    fan.push_back(std::move(line));
  }
  return fan;
}

}  // namespace pecs::lens
