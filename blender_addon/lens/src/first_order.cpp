#include "pecs/lens/first_order.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "pecs/error.h"

namespace pecs::lens {
namespace {

// Takes (y, n u) across surfaces and gaps; determinant 1.
struct Matrix {
  double a = 1, b = 0, c = 0, d = 1;
};
Matrix operator*(const Matrix& l, const Matrix& r) {
  return {l.a * r.a + l.b * r.c, l.a * r.b + l.b * r.d, l.c * r.a + l.d * r.c, l.c * r.b + l.d * r.d};
}

Matrix refraction(const Surface& s, double n_before, double n_after) {
  const double vertex_curvature = s.at(0).slope_over_r;
  return {1, 0, -(n_after - n_before) * vertex_curvature, 1};
}

}  // namespace

FirstOrder first_order(const Prescription& lens, double lambda_nm, double stop_diameter_mm) {
  const std::vector<double> n = lens.indices(lambda_nm);
  Matrix whole, to_stop, from_stop;  // first vertex -> last vertex; first vertex -> stop; stop -> last vertex
  for (std::size_t i = 0; i < lens.surfaces.size(); ++i) {
    const double n_before = i ? n[i - 1] : 1.0;
    const Matrix gap = i ? Matrix{1, (lens.surfaces[i].z_mm - lens.surfaces[i - 1].z_mm) / n_before, 0, 1} : Matrix{};
    if (i == lens.stop) to_stop = gap * whole;
    const Matrix refract = refraction(lens.surfaces[i], n_before, n[i]);
    whole = refract * gap * whole;
    // The stop's own refraction belongs to the rear part: an aperture on a glass surface is seen from the front as is.
    if (i == lens.stop) from_stop = refract;
    if (i > lens.stop) from_stop = refract * gap * from_stop;
  }
  if (!(whole.c < 0))
    throw bad_input(lens.file, "surfaces", fmt::format("a power of {:.6g} per mm", -whole.c), "a lens that converges");

  FirstOrder f{};
  f.efl_mm = -1.0 / whole.c;
  f.bfl_mm = -whole.a / whole.c;
  if (!(f.bfl_mm > 0))
    throw bad_input(lens.file, "surfaces", fmt::format("the image {:.6g} mm before the last surface", -f.bfl_mm),
                    "an image behind it");
  f.front_focus_z_mm = whole.d / whole.c;
  f.rear_focus_z_mm = lens.rear_z_mm() + f.bfl_mm;
  f.front_principal_z_mm = f.front_focus_z_mm + f.efl_mm;
  f.rear_principal_z_mm = f.rear_focus_z_mm - f.efl_mm;
  f.stop_diameter_mm = std::min(stop_diameter_mm, lens.stop_diameter_mm());
  f.entrance_pupil_z_mm = to_stop.b / to_stop.a;
  f.entrance_pupil_diameter_mm = f.stop_diameter_mm / std::abs(to_stop.a);
  f.exit_pupil_z_mm = lens.rear_z_mm() - from_stop.b / from_stop.d;
  f.exit_pupil_diameter_mm = f.stop_diameter_mm / std::abs(from_stop.d);
  f.fnumber = f.efl_mm / f.entrance_pupil_diameter_mm;
  return f;
}

double stop_diameter_for_fnumber(const Prescription& lens, double fnumber, double lambda_nm) {
  const FirstOrder open = first_order(lens, lambda_nm);
  // Catalogue f-numbers are rounded; half a percent beyond wide open counts as wide open.
  if (!(fnumber > 0) || fnumber < open.fnumber * 0.995)
    throw bad_input(lens.file, "f-number", fmt::format("{}", fnumber),
                    fmt::format(">= {:.4g}, wide open", open.fnumber));
  return open.stop_diameter_mm * std::min(1.0, open.fnumber / fnumber);
}

Ray ray_from_axis(std::optional<double> distance_m, double pupil_z_mm, double x_mm, double y_mm, double aim_z_mm) {
  const Vec3 aim{x_mm, y_mm, aim_z_mm};
  if (!distance_m) return {aim, {0, 0, 1}};
  return {aim, normalized(aim - Vec3{0, 0, pupil_z_mm - *distance_m * 1000.0})};
}

Focus best_focus(const Prescription& lens, std::span<const double> bands_nm, std::optional<double> distance_m,
                 double stop_diameter_mm) {
  constexpr int kZones = 128;
  double sum_xm = 0, sum_mm = 0, sum_xx = 0;
  std::size_t count = 0;
  for (const double lambda : bands_nm) {
    const Tracer tracer(lens, lambda, stop_diameter_mm);
    const FirstOrder f = first_order(lens, lambda, stop_diameter_mm);
    const double pupil_z = std::isfinite(f.entrance_pupil_z_mm) ? f.entrance_pupil_z_mm : 0.0;
    const auto fill = [&](double h) { return tracer.fill_to_film(ray_from_axis(distance_m, pupil_z, h, 0, pupil_z)); };
    if (distance_m && pupil_z - *distance_m * 1000.0 > std::min(0.0, f.front_focus_z_mm) - 1e-6)
      throw bad_input(lens.file, "focus", fmt::format("{} m", *distance_m),
                      fmt::format("more than {:.4g} m, the front focus", (pupil_z - f.front_focus_z_mm) * 1e-3));

    // The marginal ray, by bisection from inside.
    double inside = 0, outside = 0.5 * f.entrance_pupil_diameter_mm;
    while (fill(outside) <= 1.0) outside *= 1.5;
    for (int i = 0; i < 50; ++i) {
      const double mid = 0.5 * (inside + outside);
      (fill(mid) <= 1.0 ? inside : outside) = mid;
    }
    if (!(inside > 0)) throw bad_input(lens.file, "surfaces", "no ray from the axis through the lens", "a lens");

    // Mean square spot at rear_z + s: sum over rays of (x + m s)^2, a parabola in s.
    for (int zone = 0; zone < kZones; ++zone) {
      const double h = inside * std::sqrt((zone + 0.5) / kZones);
      const Traced t = tracer.to_film(ray_from_axis(distance_m, pupil_z, h, 0, pupil_z));
      if (t.fate != Fate::ok) continue;
      const double x = t.ray.at_z(lens.rear_z_mm()).x, m = t.ray.d.x / t.ray.d.z;
      sum_xm += x * m;
      sum_mm += m * m;
      sum_xx += x * x;
      ++count;
    }
  }
  if (!(sum_mm > 0)) throw bad_input(lens.file, "surfaces", "no ray from the axis through the lens", "a lens");
  const double s = -sum_xm / sum_mm;
  if (!(s > 0))
    throw bad_input(lens.file, "focus", fmt::format("an image {:.4g} mm before the last surface", -s), "behind it");
  const double mean_square = std::max(0.0, sum_xx + 2 * s * sum_xm + s * s * sum_mm) / static_cast<double>(count);
  return {distance_m, lens.rear_z_mm() + s, std::sqrt(mean_square)};
}

}  // namespace pecs::lens
