#include "pecs/lens/field.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
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
  // Height in the stop of the ray through x on the direction plane; NaN if it is blocked.
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

std::vector<std::vector<Vec3>> ray_fan(const Tracer& tracer, std::size_t stop, double film_z_mm, double r_mm, int count,
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
    // A diaphragm that cuts its neighbour is on the ray's line, but not on its path.
    const auto at_stop = line.begin() + static_cast<std::ptrdiff_t>(tracer.surface_count() - stop);
    if (at_stop->z > at_stop[-1].z || at_stop[1].z > at_stop->z) line.erase(at_stop);
    fan.push_back(std::move(line));
  }
  return fan;
}

Ray ObjectPoint::towards(double x_mm, double y_mm, double z_mm) const {
  const Vec3 aim{x_mm, y_mm, z_mm};
  return {aim, at_infinity ? place : normalized(aim - place)};
}

std::optional<ObjectPoint> object_point(const Tracer& reference, std::size_t stop, const Focus& focus,
                                        double pupil_z_mm, double r_mm) {
  const auto ray = chief_ray(reference, stop, focus.film_z_mm, r_mm);
  if (!ray) return std::nullopt;
  if (!focus.distance_m) return ObjectPoint{true, -1.0 * ray->d};
  return ObjectPoint{false, ray->at_z(pupil_z_mm - *focus.distance_m * 1000.0)};
}

std::vector<Vec3> spot(const Tracer& tracer, const Tracer& reference, const ObjectPoint& object, const Focus& focus,
                       double pupil_z_mm, double r_mm, int across) {
  std::vector<Vec3> hits;
  const ExactPupil pupil = exact_pupil(reference, focus.film_z_mm, r_mm, 90);
  if (pupil.area_mm2 <= 0) return hits;
  // The beam's extent on the entrance pupil's plane, from the rays of the exact pupil's edge.
  const Vec3 film{r_mm, 0, focus.film_z_mm};
  double left = std::numeric_limits<double>::infinity(), right = -left, up = 0;
  for (std::size_t j = 0; j < pupil.edge_mm.size(); ++j) {
    Vec3 aim = pupil.edge_point(j);
    aim.z = reference.rear_z_mm();
    const Traced t = reference.to_scene({film, normalized(aim - film)}, Tracer::Clip::none);
    if (t.fate != Fate::ok) continue;
    const Vec3 at = t.ray.at_z(pupil_z_mm);
    left = std::min(left, at.x);
    right = std::max(right, at.x);
    up = std::max(up, std::abs(at.y));
  }
  if (!(right > left)) return hits;
  const double half = 0.5 * (right - left) * 1.1, middle = 0.5 * (left + right);
  up *= 1.1;
  for (int i = 0; i < across; ++i)
    for (int j = 0; j < across; ++j) {
      const double x = middle + half * (2.0 * (i + 0.5) / across - 1), y = up * (2.0 * (j + 0.5) / across - 1);
      const Traced t = tracer.to_film(object.towards(x, y, pupil_z_mm));
      if (t.fate == Fate::ok) hits.push_back(t.ray.at_z(focus.film_z_mm));
    }
  return hits;
}

double rms_radius_mm(const std::vector<Vec3>& hits) {
  if (hits.empty()) return std::nan("");
  Vec3 mean;
  for (const Vec3& p : hits) mean = mean + (1.0 / static_cast<double>(hits.size())) * p;
  double sum = 0;
  for (const Vec3& p : hits) sum += (p.x - mean.x) * (p.x - mean.x) + (p.y - mean.y) * (p.y - mean.y);
  return std::sqrt(sum / static_cast<double>(hits.size()));
}

Mtf geometric_mtf(const std::vector<Vec3>& hits, double cycles_per_mm) {
  double cx = 0, sx = 0, cy = 0, sy = 0;
  const double w = 2 * std::numbers::pi * cycles_per_mm, n = static_cast<double>(std::max<std::size_t>(1, hits.size()));
  for (const Vec3& p : hits) {
    cx += std::cos(w * p.x);
    sx += std::sin(w * p.x);
    cy += std::cos(w * p.y);
    sy += std::sin(w * p.y);
  }
  return {std::hypot(cx, sx) / n, std::hypot(cy, sy) / n};
}

MtfCurve wavefront_mtf(const Prescription& lens, const Tracer& tracer, const ObjectPoint& object, const Focus& focus,
                       double r_mm, double max_cycles_per_mm) {
  constexpr int kAcross = 256;
  MtfCurve curve;
  const ExactPupil pupil = exact_pupil(tracer, focus.film_z_mm, r_mm, 180);
  if (pupil.area_mm2 <= 0) return curve;
  const Vec3 film{r_mm, 0, focus.film_z_mm};
  double low = std::numeric_limits<double>::infinity(), high = -low, up = 0;  // direction cosines of the pupil's edge
  for (std::size_t j = 0; j < pupil.edge_mm.size(); ++j) {
    Vec3 aim = pupil.edge_point(j);
    aim.z = tracer.rear_z_mm();
    const Vec3 d = normalized(aim - film);
    low = std::min(low, d.x);
    high = std::max(high, d.x);
    up = std::max(up, std::abs(d.y));
  }

  // The pupil function on a grid of direction cosines.
  const double lambda_mm = tracer.lambda_nm() * 1e-6, step = std::max(high - low, 2 * up) / kAcross;
  const int nx = static_cast<int>(std::ceil((high - low) / step)), ny = static_cast<int>(std::ceil(2 * up / step));
  const std::vector<double> n = lens.indices(tracer.lambda_nm());
  std::vector<std::complex<double>> field(static_cast<std::size_t>(nx) * ny);
  std::vector<Vec3> hits;
  std::optional<double> first;
  double power = 0;
  for (int i = 0; i < nx; ++i)
    for (int j = 0; j < ny; ++j) {
      const double dx = low + (i + 0.5) * step, dy = (j + 0.5 - 0.5 * ny) * step;
      hits.assign(1, film);
      const Traced t =
          tracer.to_scene({film, {dx, dy, -std::sqrt(1 - dx * dx - dy * dy)}}, Tracer::Clip::housing, &hits);
      if (t.fate != Fate::ok) continue;
      double path = 0;  // n behind the last surface is that of air, 1
      for (std::size_t k = 1; k < hits.size(); ++k) {
        const Vec3 way = hits[k] - hits[k - 1];
        path += n[n.size() - k] * std::copysign(std::sqrt(dot(way, way)), -way.z);  // negative back from a diaphragm
      }
      // Path to the plane wave through the origin, or to the point closest to the object point.
      const Vec3 from = hits.back();
      path += object.at_infinity ? -dot(from, object.place) / dot(t.ray.d, object.place)
                                 : dot(object.place - from, t.ray.d);
      if (!first) first = path;
      field[static_cast<std::size_t>(i) * ny + j] = std::polar(1.0, 2 * std::numbers::pi * (path - *first) / lambda_mm);
      power += 1;
    }
  if (!(power > 0)) return curve;

  // A shift by m cells is the frequency m step / lambda.
  const int last = static_cast<int>(max_cycles_per_mm * lambda_mm / step), every = std::max(1, last / 40);
  for (int m = 0; m <= last; m += every) {
    std::complex<double> t = 0, s = 0;
    for (int i = 0; i < nx; ++i)
      for (int j = 0; j < ny; ++j) {
        const auto here = std::conj(field[static_cast<std::size_t>(i) * ny + j]);
        if (i + m < nx) t += here * field[static_cast<std::size_t>(i + m) * ny + j];
        if (j + m < ny) s += here * field[static_cast<std::size_t>(i) * ny + j + m];
      }
    curve.cycles_per_mm.push_back(m * step / lambda_mm);
    curve.tangential.push_back(std::abs(t) / power);
    curve.sagittal.push_back(std::abs(s) / power);
  }
  return curve;
}

namespace {

// Radius on the film of the chief ray of the object point at height or slope `tangent` (tan of the angle at infinity,
// or height on the focused plane).
double tangent_of(const Ray& ray, const Focus& focus, double pupil_z_mm) {
  if (!focus.distance_m) return ray.d.x / ray.d.z;
  return ray.at_z(pupil_z_mm - *focus.distance_m * 1000.0).x;
}

double chief_radius(const Tracer& tracer, std::size_t stop, const Focus& focus, double pupil_z_mm, double tangent,
                    double guess) {
  const auto at = [&](double r) {
    const auto ray = chief_ray(tracer, stop, focus.film_z_mm, r);
    return ray ? tangent_of(*ray, focus, pupil_z_mm) - tangent : std::nan("");
  };
  double r0 = guess, r1 = guess * 1.001 + 1e-6, f0 = at(r0), f1 = at(r1);
  for (int i = 0; i < 20 && std::isfinite(f1) && f1 != f0 && std::abs(r1 - r0) > 1e-11; ++i) {
    const double r = r1 - f1 * (r1 - r0) / (f1 - f0);
    r0 = r1;
    f0 = f1;
    r1 = r;
    f1 = at(r);
  }
  return r1;
}

}  // namespace

std::vector<FieldRow> field_rows(const Prescription& lens, const std::vector<double>& bands_nm, double reference_nm,
                                 double stop_diameter_mm, const Focus& focus, double max_r_mm, int rows) {
  const Tracer reference(lens, reference_nm, stop_diameter_mm);
  std::vector<Tracer> tracers;
  for (const double lambda : bands_nm) tracers.emplace_back(lens, lambda, stop_diameter_mm);
  const double pupil_z = first_order(lens, reference_nm, stop_diameter_mm).entrance_pupil_z_mm;
  const double e0 = exact_pupil(reference, focus.film_z_mm, 0).irradiance_per_radiance;
  const double small = 1e-4 * max_r_mm;
  const auto axis = chief_ray(reference, lens.stop, focus.film_z_mm, small);
  const double k = axis ? small / tangent_of(*axis, focus, pupil_z) : std::nan("");

  std::vector<FieldRow> out;
  for (int i = 0; i < rows; ++i) {
    FieldRow row{};
    row.r_mm = max_r_mm * i / std::max(1, rows - 1);
    row.relative_illumination = exact_pupil(reference, focus.film_z_mm, row.r_mm).irradiance_per_radiance / e0;
    const auto chief = chief_ray(reference, lens.stop, focus.film_z_mm, row.r_mm);
    const auto object = object_point(reference, lens.stop, focus, pupil_z, row.r_mm);
    row.angle_deg = chief ? std::atan2(std::abs(chief->d.x), -chief->d.z) * 180 / std::numbers::pi : std::nan("");
    const double tangent = chief ? tangent_of(*chief, focus, pupil_z) : std::nan("");
    row.distortion_percent = i == 0 ? 0.0 : 100 * (row.r_mm / (k * tangent) - 1);
    for (const Tracer& tracer : tracers) {
      row.lateral_colour_um.push_back(
          i == 0 || !chief ? 0.0
                           : 1e3 * (chief_radius(tracer, lens.stop, focus, pupil_z, tangent, row.r_mm) - row.r_mm));
      row.rms_spot_um.push_back(
          object ? 1e3 * rms_radius_mm(spot(tracer, reference, *object, focus, pupil_z, row.r_mm, 32)) : std::nan(""));
    }
    out.push_back(std::move(row));
  }
  return out;
}

}  // namespace pecs::lens
