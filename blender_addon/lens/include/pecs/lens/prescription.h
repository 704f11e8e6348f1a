#pragma once
// A lens as its file states it (lens_data/SCHEMA.md). Conventions of the whole room: millimetres; the first vertex is
// z = 0 and +z runs from the object to the film; a radius is positive when its centre lies at larger z; a
// semi-diameter is the housing's.
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "pecs/lens/glass.h"
#include "pecs/strict_json.h"

namespace pecs::lens {

// sag(r) = c r^2 / (1 + sqrt(1 - (1 + k) c^2 r^2)) + sum over p of powers[p] r^p
struct Surface {
  double curvature = 0;        // c = 1/radius [1/mm], 0 = plane
  double conic = 0;            // k
  std::vector<double> powers;  // [mm^(1-p)] by p; empty without aspheric terms
  double z_mm = 0;             // of the vertex
  double semi_diameter_mm = 0;
  Glass after;  // the medium behind it
  double sag_mm(double r_mm) const;
  double slope(double r_mm) const;  // d sag / d r
};

struct Prescription {
  std::string name, file, sha256;
  std::vector<Surface> surfaces;
  std::size_t stop = 0;  // index of the aperture stop
  std::optional<double> nominal_efl_mm, nominal_fnumber;

  double rear_z_mm() const { return surfaces.back().z_mm; }
  // From surface i to surface j behind it at radius r; below 0 they cross there.
  double gap_mm(std::size_t i, std::size_t j, double r_mm) const;
  // The stop is a plane within one medium: it blocks, and does not refract. Its plane may cut its neighbours.
  bool stop_is_diaphragm() const;
  double stop_diameter_mm() const { return 2.0 * surfaces[stop].semi_diameter_mm; }  // wide open
  // Index behind each surface. Throws bad_input, naming the surface, for a wavelength outside a glass's range.
  std::vector<double> indices(double lambda_nm) const;
};

// Reads and checks a file; throws bad_input naming file and surface. A name without '/' and ".json" is one of
// lens_data/lenses; ".zmx" is read as Zemax's, ".dat" and ".txt" as pbrt's (exchange.h).
Prescription load_prescription(const std::string& name_or_path);
// The lens as a file of lens_data/SCHEMA.md holds it, unchecked.
Json load_lens_json(const std::string& name_or_path);

}  // namespace pecs::lens
