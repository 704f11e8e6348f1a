#include "pecs/lens/trace.h"

#include <fmt/format.h>

#include <algorithm>

namespace pecs::lens {
namespace {

struct Hit {
  Vec3 p;       // relative to the vertex
  Vec3 normal;  // unit, along the light (+z at the vertex)
};

// Intersection of the line with a conic, in the sense `direction` (+1: from object to film).
bool meet_conic(double c, double k, Ray ray, int direction, Hit& hit) {
  // From the point of the line nearest to the vertex, against cancellation.
  const Vec3 p = ray.p - dot(ray.p, ray.d) * ray.d;
  const Vec3 d = ray.d;
  // c (x^2 + y^2 + (1+k) z^2) - 2 z = 0 along p + t d: A t^2 - 2 B t + C = 0.
  const double a = c * (1.0 + k * d.z * d.z);
  const double b = d.z - c * k * p.z * d.z;
  const double cc = c * (dot(p, p) + k * p.z * p.z) - 2.0 * p.z;
  const double disc = b * b - a * cc;
  if (disc < 0) return false;
  const double s = direction * std::sqrt(disc);  // = gradient . d / 2 at the wanted root
  double t = 0;
  if (b * s > 0)
    t = cc / (b + s);
  else if (a != 0)
    t = (b - s) / a;
  else
    return false;
  hit.p = p + t * d;
  const double gz = 1.0 - (1.0 + k) * c * hit.p.z;
  if (gz <= 0) return false;  // beyond the equator
  hit.normal = normalized({-c * hit.p.x, -c * hit.p.y, gz});
  return true;
}

// Newton's method on z - sag(r) from the conic, or from the vertex plane where the line misses the conic.
bool meet_asphere(const Profile& profile, Ray ray, int direction, Hit& hit) {
  if (!meet_conic(profile.curvature, profile.conic, ray, direction, hit)) {
    if (std::abs(ray.d.z) < 1e-6) return false;
    hit.p = ray.at_z(0);
  }
  Vec3 p = hit.p;
  for (int i = 0; i < 50; ++i) {
    const Profile::Point at = profile.at(p.x * p.x + p.y * p.y);
    if (!std::isfinite(at.slope_over_r)) return false;
    const double f = p.z - at.sag_mm;
    const Vec3 gradient{-at.slope_over_r * p.x, -at.slope_over_r * p.y, 1.0};
    const double along = dot(gradient, ray.d);
    if (along * direction <= 0) return false;
    p = p - (f / along) * ray.d;
    if (std::abs(f) < 1e-14 * (1.0 + std::abs(p.z)) || (i == 49 && std::abs(f) < 1e-11)) {
      hit.p = p;
      hit.normal = normalized(gradient);
      return true;
    }
  }
  return false;
}

}  // namespace

std::string fate_text(const Traced& traced) {
  switch (traced.fate) {
    case Fate::ok:
      return "ok";
    case Fate::clipped:
      return fmt::format("clipped:{}", traced.surface);
    case Fate::missed:
      return fmt::format("missed:{}", traced.surface);
    case Fate::tir:
      return fmt::format("tir:{}", traced.surface);
  }
  return "";
}

Tracer::Tracer(const Prescription& lens, double lambda_nm, double stop_diameter_mm) : lambda_nm_(lambda_nm) {
  build(lens, lens.indices(lambda_nm), stop_diameter_mm);
}

Tracer::Tracer(const Prescription& lens, std::span<const double> n_after, double stop_diameter_mm) {
  build(lens, n_after, stop_diameter_mm);
}

void Tracer::build(const Prescription& lens, std::span<const double> n_after, double stop_diameter_mm) {
  double n_before = 1.0;
  for (std::size_t i = 0; i < lens.surfaces.size(); ++i) {
    const Surface& s = lens.surfaces[i];
    const double semi = i == lens.stop ? std::min(s.semi_diameter_mm, 0.5 * stop_diameter_mm) : s.semi_diameter_mm;
    surfaces_.push_back({s, s.z_mm, semi, n_before, n_after[i]});
    n_before = n_after[i];
  }
}

// on_hit(surface index, hit, r^2 / semi^2) returns false to stop the ray there.
template <class OnHit>
Traced Tracer::walk(Ray ray, int direction, OnHit&& on_hit) const {
  const int count = static_cast<int>(surfaces_.size());
  for (int step = 0; step < count; ++step) {
    const int i = direction > 0 ? step : count - 1 - step;
    const Element& s = surfaces_[i];

    const Ray local{{ray.p.x, ray.p.y, ray.p.z - s.z}, ray.d};
    Hit hit;
    const bool met = s.profile.is_conic() ? meet_conic(s.profile.curvature, s.profile.conic, local, direction, hit)
                                          : meet_asphere(s.profile, local, direction, hit);
    if (!met) return {ray, Fate::missed, i};
    const Vec3 point{hit.p.x, hit.p.y, hit.p.z + s.z};
    if (!on_hit(i, point, (point.x * point.x + point.y * point.y) / (s.semi * s.semi))) return {ray, Fate::clipped, i};
    ray.p = point;

    // Snell's law, vector form; the normal points along the light.
    const double eta = direction > 0 ? s.n_before / s.n_after : s.n_after / s.n_before;
    if (eta == 1.0) continue;
    const Vec3 normal = direction > 0 ? hit.normal : -1.0 * hit.normal;
    const double cos_in = dot(ray.d, normal);
    const double cos_out2 = 1.0 - eta * eta * (1.0 - cos_in * cos_in);
    if (cos_out2 < 0) return {ray, Fate::tir, i};
    ray.d = normalized(eta * ray.d + (std::sqrt(cos_out2) - eta * cos_in) * normal);
  }
  return {ray, Fate::ok, -1};
}

Traced Tracer::clipped_walk(Ray ray, int direction, Clip clip, std::vector<Vec3>* hits) const {
  return walk(ray, direction, [&](int, Vec3 point, double fill2) {
    if (clip == Clip::housing && fill2 > 1.0) return false;
    if (hits) hits->push_back(point);
    return true;
  });
}

Traced Tracer::to_film(Ray ray, Clip clip, std::vector<Vec3>* hits) const { return clipped_walk(ray, +1, clip, hits); }
Traced Tracer::to_scene(Ray ray, Clip clip, std::vector<Vec3>* hits) const { return clipped_walk(ray, -1, clip, hits); }

double Tracer::fill(Ray ray, int direction) const {
  double most2 = 0;
  const Traced traced = walk(ray, direction, [&](int, Vec3, double fill2) {
    most2 = std::max(most2, fill2);
    return true;
  });
  return traced.fate == Fate::ok ? std::sqrt(most2) : std::numeric_limits<double>::infinity();
}

}  // namespace pecs::lens
