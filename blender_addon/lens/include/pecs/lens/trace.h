#pragma once
// Exact ray tracing through a prescription at one wavelength, in either direction, in double precision.
// A diaphragm's plane may cut a curved neighbour: the stop clips a ray where its straight line between the two
// neighbours meets the plane, even within the neighbour's glass. Design programs, whose pupils and f-numbers patents
// list, do the same; both directions agree, and the order in which a ray meets the two does not matter.
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "pecs/lens/prescription.h"

namespace pecs::lens {

struct Vec3 {
  double x = 0, y = 0, z = 0;
};
inline double dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec3 operator*(double s, Vec3 a) { return {s * a.x, s * a.y, s * a.z}; }
inline Vec3 normalized(Vec3 a) { return (1.0 / std::sqrt(dot(a, a))) * a; }

struct Ray {
  Vec3 p;  // mm, lens frame
  Vec3 d;  // unit length
  Vec3 at_z(double z_mm) const { return p + ((z_mm - p.z) / d.z) * d; }
};

enum class Fate : std::uint8_t { ok, clipped, missed, tir };

struct Traced {
  Ray ray;  // behind the last surface it passed
  Fate fate = Fate::ok;
  int surface = -1;  // where it ended, when not ok
};
std::string fate_text(const Traced& traced);  // "ok", "clipped:3", "missed:0", "tir:5"

inline constexpr double kWideOpen = std::numeric_limits<double>::infinity();

class Tracer {
 public:
  // Closes the stop to the diameter given, if that is smaller than its own.
  Tracer(const Prescription& lens, double lambda_nm, double stop_diameter_mm = kWideOpen);
  // n_after: refractive index behind each surface.
  Tracer(const Prescription& lens, std::span<const double> n_after, double stop_diameter_mm = kWideOpen);

  enum class Clip { housing, none };
  // Scene to film (d.z > 0), film to scene (d.z < 0). The ray may start anywhere on its line. `hits`: one point per
  // surface passed, in the lens frame; the step to or from a diaphragm that cuts its neighbour goes backward.
  Traced to_film(Ray ray, Clip clip = Clip::housing, std::vector<Vec3>* hits = nullptr) const;
  Traced to_scene(Ray ray, Clip clip = Clip::housing, std::vector<Vec3>* hits = nullptr) const;

  // The largest (hit radius / semi-diameter) of all surfaces: a ray with <= 1 passes. Infinite when the ray misses a
  // surface or is totally reflected.
  double fill_to_film(Ray ray) const { return fill(ray, +1); }
  double fill_to_scene(Ray ray) const { return fill(ray, -1); }

  double lambda_nm() const { return lambda_nm_; }  // 0 when built from indices
  double rear_z_mm() const { return surfaces_.back().z; }
  std::size_t surface_count() const { return surfaces_.size(); }
  double rear_semi_diameter_mm() const { return surfaces_.back().semi; }

 private:
  struct Element {  // one surface at the tracer's wavelength and stop
    Profile profile;
    double z, semi, n_before, n_after;
  };
  template <class OnHit>
  Traced walk(Ray ray, int direction, OnHit&& on_hit) const;
  Traced clipped_walk(Ray ray, int direction, Clip clip, std::vector<Vec3>* hits) const;
  double fill(Ray ray, int direction) const;
  void build(const Prescription& lens, std::span<const double> n_after, double stop_diameter_mm);

  double lambda_nm_ = 0;
  std::vector<Element> surfaces_;
};

}  // namespace pecs::lens
