#pragma once
// A lens as in its file (lens_data/SCHEMA.md). Conventions of this folder: millimetres; the first vertex is z = 0 and
// +z runs from the object to the film; a radius is positive when its centre lies at larger z; a semi-diameter is the
// housing's.
//
// All of pecs_lens assumes rotational symmetry about z: a surface is sag_mm(r), the pupil tables (pupil.h) and the
// image map (image_map.h) run over the film radius, and the camera's shader turns the film point to azimuth 0. A toroid
// or a decentred element breaks each of these. To add a rotationally symmetric surface:
//   1. Profile below: its terms, is_conic(); Profile::at and the keys (read_surface) in src/prescription.cpp.
//   2. The same equation in OSL: meet_text in src/osl_shader.cpp.
//   3. lens_data/SCHEMA.md, and a lens in tests/lens.
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "pecs/lens/glass.h"
#include "pecs/strict_json.h"

namespace pecs::lens {

// sag(r) = c r^2 / (1 + sqrt(1 - (1 + k) c^2 r^2)) + sum over p >= 2 of powers[p] r^p
struct Profile {
  double curvature = 0;        // c = 1/radius [1/mm], 0 = plane
  double conic = 0;            // k
  std::vector<double> powers;  // [mm^(1-p)] by p; empty without aspheric terms

  struct Point {
    double sag_mm, slope_over_r;  // slope: d sag / d r; NaN or infinite where the conic has ended
  };
  Point at(double r2_mm2) const;
  double sag_mm(double r_mm) const { return at(r_mm * r_mm).sag_mm; }
  bool is_conic() const { return powers.empty(); }  // no term but the first
  bool is_sphere() const { return is_conic() && conic == 0; }
  bool is_plane() const { return is_conic() && curvature == 0; }
  double slope(double r_mm) const { return r_mm * at(r_mm * r_mm).slope_over_r; }
};

struct Surface : Profile {
  double z_mm = 0;  // of the vertex
  double semi_diameter_mm = 0;
  Glass after;  // the medium behind it
};

struct Prescription {
  std::string name, file, sha256;
  std::vector<Surface> surfaces;
  std::size_t stop = 0;  // index of the aperture stop
  std::optional<double> nominal_efl_mm, nominal_fnumber;
  std::vector<std::string> notes;  // what an import replaced

  double rear_z_mm() const { return surfaces.back().z_mm; }
  // Distance from surface i to surface j behind it at radius r; negative where they cross.
  double gap_mm(std::size_t i, std::size_t j, double r_mm) const;
  // True if the stop is a plane within one medium: it blocks and does not refract. Its plane may cut its neighbours.
  bool stop_is_diaphragm() const;
  double stop_diameter_mm() const { return 2.0 * surfaces[stop].semi_diameter_mm; }  // wide open
  // Index behind each surface. Throws bad_input, naming the surface, for a wavelength outside a glass's range.
  std::vector<double> indices(double lambda_nm) const;
};

// Reads and checks a file; throws bad_input naming file and surface. A name without '/' and ".json" is one of
// lens_data/lenses; ".zmx" is read as Zemax's, ".dat" and ".txt" as pbrt's (exchange.h).
Prescription load_prescription(const std::string& name_or_path);
// The lens in the form of lens_data/SCHEMA.md, unchecked.
Json load_lens_json(const std::string& name_or_path);

}  // namespace pecs::lens
