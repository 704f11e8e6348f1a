#include "pecs/lens/image_map.h"

#include <gtest/gtest.h>

#include <cmath>
#include <tuple>

#include "lenses.h"
#include "pecs/error.h"
#include "pecs/lens/field.h"

namespace pecs::lens {
namespace {

enum class Film { centred, shifted, tilted };

ImageSetting setting_of(Film film) {
  ImageSetting s;
  s.width_px = 640, s.height_px = 360, s.pixel_pitch_mm = 0.00972;
  s.focus_m = 3;
  if (film != Film::centred) s.film_shift_x_mm = 0.4, s.film_shift_y_mm = -0.25;
  if (film == Film::tilted) s.film_tilt_x_deg = 3, s.film_tilt_y_deg = -4;
  return s;
}

struct EveryMap : testing::TestWithParam<std::tuple<std::string, Film>> {
  Prescription lens = load_prescription(std::get<0>(GetParam()));
  Film film = std::get<1>(GetParam());
  ImageSetting setting = setting_of(film);
  ImageMap map{lens, setting};
};

TEST_P(EveryMap, BothWaysAreEachOthersInverse) {
  int covered = 0;
  double worst_px = 0;
  for (double y = 0; y <= setting.height_px; y += 7.5)
    for (double x = 0; x <= setting.width_px; x += 8) {
      const auto d = map.direction_from_pixel({x, y});
      if (!d) continue;
      ++covered;
      EXPECT_NEAR(dot(*d, *d), 1, 1e-12);
      const auto back = map.pixel_from_direction(2.5 * *d);  // any length
      ASSERT_TRUE(back) << x << " " << y;
      worst_px = std::max(worst_px, std::hypot(back->x - x, back->y - y));
    }
  EXPECT_GT(covered, 3500) << "of 3969";
  EXPECT_LT(worst_px, 1e-6);
}

// A chief ray found between the table's nodes: from the film point through the middle of the stop.
TEST_P(EveryMap, IsTheTracedChiefRay) {
  const Tracer tracer(lens, setting.lambda_nm, setting.stop_diameter_mm);
  const double bands[] = {setting.lambda_nm};
  const Focus focus = best_focus(lens, bands, setting.focus_m, setting.stop_diameter_mm);
  const double pupil_z = first_order(lens, setting.lambda_nm, setting.stop_diameter_mm).entrance_pupil_z_mm;
  const FilmAxes axes = film_axes(setting.film_tilt_x_deg, setting.film_tilt_y_deg);
  for (const auto& [x, y] : {std::pair{0.5, 0.5}, {321.3, 180.2}, {100.7, 300.1}, {639.5, 359.5}, {610.2, 20.9}}) {
    const auto ray = map.ray_from_pixel({x, y});
    if (!ray) continue;
    const Vec3 p = Vec3{setting.film_shift_x_mm, setting.film_shift_y_mm, focus.film_z_mm} +
                   ((320 - x) * setting.pixel_pitch_mm) * axes.right + ((y - 180) * setting.pixel_pitch_mm) * axes.up;
    const double r = std::hypot(p.x, p.y);
    const auto chief = chief_ray(tracer, lens.stop, p.z, r);
    ASSERT_TRUE(chief);
    // Turned to the film point's azimuth; from the lens frame to camera axes (y down, z forward).
    const auto turned = [&](Vec3 v) { return Vec3{v.x * p.x / r, -v.x * p.y / r, -v.z}; };
    const Vec3 d = turned(chief->d), from = turned(chief->p - Vec3{0, 0, pupil_z});
    const double px_per_rad = first_order(lens, setting.lambda_nm).efl_mm / setting.pixel_pitch_mm;
    const Vec3 apart = d - ray->d;
    EXPECT_LT(std::sqrt(dot(apart, apart)) * px_per_rad, 1e-3) << x << " " << y;
    const Vec3 nearest = from - dot(from, d) * d, off = nearest - ray->p;
    EXPECT_LT(std::sqrt(dot(off, off)), 1e-5) << "mm; " << x << " " << y;
  }
}

std::string film_name(Film film) {
  return film == Film::centred ? "centred" : film == Film::shifted ? "shifted" : "tilted";
}

INSTANTIATE_TEST_SUITE_P(Lenses, EveryMap,
                         testing::Combine(testing::ValuesIn(tests::lens_files(false)),
                                          testing::Values(Film::centred, Film::shifted, Film::tilted)),
                         [](const auto& tested) {
                           return tests::test_name(std::get<0>(tested.param)) + "_" +
                                  film_name(std::get<1>(tested.param));
                         });

TEST(ImageMap, AxesAndPixelCentres) {
  const ImageMap map(load_prescription("pecs_lab_15mm"), {.width_px = 101, .height_px = 51});
  const auto middle = map.direction_from_pixel({50.5, 25.5});  // the centre of pixel (50, 25)
  ASSERT_TRUE(middle);
  EXPECT_EQ(middle->z, 1);
  const auto right = map.direction_from_pixel({60, 25.5}), down = map.direction_from_pixel({50.5, 30});
  EXPECT_GT(right->x, 0);
  EXPECT_NEAR(right->y, 0, 1e-15);
  EXPECT_GT(down->y, 0);
  EXPECT_NEAR(right->x / right->z / (9.5 * 0.00486 / 15.018), 1, 0.005);  // by the focal length
  // The film to the right of the axis, seen from behind, sees what lies to the left, which is left in the picture.
  const ImageMap shifted(load_prescription("pecs_lab_15mm"),
                         {.width_px = 101, .height_px = 51, .film_shift_x_mm = 0.1});
  EXPECT_LT(shifted.direction_from_pixel({50.5, 25.5})->x, 0);
}

}  // namespace
}  // namespace pecs::lens
