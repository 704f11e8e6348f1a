#pragma once
// Map between directions of the scene and pixels: the chief ray of every film point, through the prescription.
//
// Camera axes: x right, y down, z forward, the origin at the centre of the entrance pupil (Blender's camera has y up
// and looks along -z). Pixels: x right, y down, (0, 0) the picture's top left corner, so pixel (0, 0) has its centre at
// (0.5, 0.5). Film shift and tilt as in osl_camera.h.
#include <optional>
#include <vector>

#include "pecs/lens/first_order.h"

namespace pecs::lens {

struct ImageSetting {
  int width_px = 1280, height_px = 720;
  double pixel_pitch_mm = 0.00486;
  double lambda_nm = 550;                   // of the chief rays
  std::vector<double> focus_bands_nm = {};  // all bands of the stack; empty: lambda_nm
  std::optional<double> focus_m = {};       // none = infinity
  double stop_diameter_mm = kWideOpen;
  double film_shift_x_mm = 0, film_shift_y_mm = 0;
  double film_tilt_x_deg = 0, film_tilt_y_deg = 0;
};

// The film's own axes and its normal towards the scene, in the lens frame.
struct FilmAxes {
  Vec3 right, up, ahead;
};
FilmAxes film_axes(double tilt_x_deg, double tilt_y_deg);

struct Pixel {
  double x = 0, y = 0;
};

// Chief rays are tabulated over film radius (and film height, of a tilted film); both directions use one table, so that
// they are exact inverses. The table reaches 10 % beyond the picture's corners. nullopt: no chief ray there.
class ImageMap {
 public:
  ImageMap(const Prescription& lens, const ImageSetting& setting);

  std::optional<Vec3> direction_from_pixel(Pixel pixel) const;  // unit length
  std::optional<Pixel> pixel_from_direction(Vec3 direction) const;
  // The chief ray itself [mm]; p is its point nearest to the origin. It misses the origin by the pupil's aberration.
  std::optional<Ray> ray_from_pixel(Pixel pixel) const;

 private:
  struct Chief {  // over the film radius r: both are even functions of it
    double angle_per_mm = 0, offset_per_mm = 0;
  };
  struct FilmPoint {
    double x, y, dz;  // dz: behind the film's centre
  };
  void tabulate(const Prescription& lens, double max_r_mm);
  FilmPoint film_point(Pixel pixel) const;
  bool reaches(double r_mm, double dz_mm) const;
  Chief in_layer(std::size_t layer, double r_mm) const;
  Chief at(double r_mm, double dz_mm) const;
  double radius_at(double angle) const;  // [mm], on a film without tilt

  ImageSetting setting_;
  FilmAxes axes_;
  double step_mm_ = 0, max_dz_mm_ = 0;
  std::vector<std::vector<Chief>> layers_;  // [layer][node]: dz from -max_dz to max_dz, r at node * step
};

}  // namespace pecs::lens
