#include "pecs/lens/pupil.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "lenses.h"
#include "pecs/lens/first_order.h"

namespace pecs::lens {
namespace {

constexpr double kHalfDiagonal = 3.569;  // 1280 x 720 pixels of 4.86 um
constexpr double kFullFrame = 21.633;    // 36 x 24 mm

struct Setting {
  Prescription lens;
  double stop, film_z;
  Tracer tracer;
};
Setting setting(const std::string& file, double lambda_nm = 550, double fnumber = 0) {
  Prescription lens = load_prescription(file);
  const double stop = fnumber > 0 ? stop_diameter_for_fnumber(lens, fnumber) : lens.stop_diameter_mm();
  const double bands[] = {lambda_nm};
  const double film_z = best_focus(lens, bands, std::nullopt, stop).film_z_mm;
  const Tracer tracer(lens, lambda_nm, stop);
  return {std::move(lens), stop, film_z, tracer};
}

struct EveryPupil : tests::EveryLens {};
struct ShippedPupil : tests::EveryLens {};

TEST_P(EveryPupil, ExactPupilMeetsBruteForce) {
  const Setting s = setting(GetParam());
  for (const double part : {0.0, 1.0}) {
    const ExactPupil pupil = exact_pupil(s.tracer, s.film_z, part * kHalfDiagonal);
    ASSERT_GT(pupil.area_mm2, 0);
    // The reference: a grid of four times the area of the rear aperture, which assumes no shape of the pupil.
    const double reach = 2 * s.tracer.rear_semi_diameter_mm(), step = 2 * reach / 400;
    double area = 0, irradiance = 0;
    const double d = s.film_z - s.tracer.rear_z_mm();
    for (double x = -reach + step / 2; x < reach; x += step)
      for (double y = step / 2; y < reach; y += step) {
        const Vec3 film{pupil.r_mm, 0, s.film_z}, way = Vec3{x, y, s.tracer.rear_z_mm()} - film;
        if (s.tracer.to_scene({film, normalized(way)}).fate != Fate::ok) continue;
        area += 2 * step * step;
        irradiance += 2 * step * step * d * d / std::pow(dot(way, way), 2);
      }
    EXPECT_NEAR(pupil.area_mm2 / area, 1.0, 0.015);
    EXPECT_NEAR(pupil.irradiance_per_radiance / irradiance, 1.0, 0.015);
  }
}

// Fields (12 radii between the nodes, on both films as far as they are lit), wavelengths and stops.
TEST_P(ShippedPupil, InterpolatedEllipsesMissNothing) {
  for (const double lambda : {400.0, 1000.0})
    for (const double fnumber : {0.0, 5.6}) {
      if (fnumber > 0 && fnumber < first_order(load_prescription(GetParam()), kLambdaD).fnumber) continue;
      for (const double max_r : {kHalfDiagonal, kFullFrame}) {
        const Setting s = setting(GetParam(), lambda, fnumber);
        if (exact_pupil(s.tracer, s.film_z, max_r).area_mm2 <= 0) continue;
        const PupilTable table = pupil_table(s.tracer, s.film_z, max_r);
        EXPECT_LE(table.missed_fraction, 1e-4);
        for (int i = 0; i < 12; ++i) {
          const double r = max_r * (i + 0.37) / 12;
          const ExactPupil pupil = exact_pupil(s.tracer, s.film_z, r, 250);
          EXPECT_LE(missed_fraction(pupil, table.ellipse_at(r)), 1e-4) << lambda << " nm, F/" << fnumber << ", " << r;
          EXPECT_NEAR(table.area_at(r) / pupil.area_mm2, 1.0, 2e-3) << lambda << " nm, F/" << fnumber << ", " << r;
          EXPECT_GT(pupil.area_mm2 / table.ellipse_at(r).area_mm2(), 0.7) << r;
        }
      }
    }
}

TEST_P(ShippedPupil, ATiltedFilmMissesNothing) {
  const Setting s = setting(GetParam());
  const double max_dz = std::min(0.5, 0.5 * (s.film_z - s.lens.rear_z_mm()));
  const PupilTables tables = pupil_tables(s.tracer, s.film_z, kHalfDiagonal, max_dz);
  EXPECT_GE(tables.layers.size(), 5u);
  EXPECT_LE(tables.missed_fraction, 1e-4);
  for (int i = 0; i < 8; ++i)
    for (int j = 0; j < 7; ++j) {
      const double r = kHalfDiagonal * (i + 0.37) / 8, dz = max_dz * (2 * (j + 0.43) / 7 - 1);
      const ExactPupil pupil = exact_pupil(s.tracer, s.film_z + dz, r);
      EXPECT_LE(missed_fraction(pupil, tables.ellipse_at(r, dz)), 1e-4) << r << ' ' << dz;
      EXPECT_NEAR(tables.area_at(r, dz) / pupil.area_mm2, 1.0, 2e-3) << r << ' ' << dz;
    }
}
PECS_EVERY_LENS(EveryPupil);
PECS_SHIPPED_LENS(ShippedPupil);

TEST(Pupil, EllipseOfACircleAndOfALens) {
  ExactPupil circle;
  circle.centre_x_mm = 2;
  circle.edge_mm.assign(360, 1.5);
  circle.area_mm2 = std::numbers::pi * 2.25;
  const Ellipse e = covering_ellipse(circle);
  EXPECT_NEAR(e.p_mm, 2, 1e-3);
  EXPECT_NEAR(e.a_mm, 1.5, 1e-3);
  EXPECT_NEAR(e.b_mm, 1.5, 1e-3);
  EXPECT_LT(missed_fraction(circle, e), 1e-9);
  EXPECT_NEAR(missed_fraction(circle, {2, 0.75, 0.75}), 0.75, 1e-9);
}

TEST(Pupil, AcceptanceOfTheDoubleGauss) {  // required: >= .99 / .93 / .88 at f/2, centre / half / corner of 36 x 24 mm
  const Setting s = setting("dgauss_50mm_tronnier");
  const double corner = 0.5 * std::hypot(36.0, 24.0);
  const PupilTable table = pupil_table(s.tracer, s.film_z, corner);
  EXPECT_LE(table.missed_fraction, 1e-5);
  const auto acceptance = [&](double r) { return table.area_at(r) / table.ellipse_at(r).area_mm2(); };
  EXPECT_GE(acceptance(0), 0.99);
  EXPECT_GE(acceptance(0.5 * corner), 0.93);
  EXPECT_GE(acceptance(corner), 0.88);
}

TEST(Pupil, UnvignettedFieldFollowsTheFourthPowerOfTheCosine) {
  const Setting s = setting("dgauss_50mm_tronnier", 550, 8);
  const FirstOrder f = first_order(s.lens, 550, s.stop);
  const double e0 = exact_pupil(s.tracer, s.film_z, 0).irradiance_per_radiance;
  for (const double r : {3.0, 6.0, 9.0}) {
    const double cos = std::cos(std::atan(r / (s.film_z - f.exit_pupil_z_mm)));
    EXPECT_NEAR(exact_pupil(s.tracer, s.film_z, r).irradiance_per_radiance / e0 / std::pow(cos, 4), 1.0, 0.03) << r;
  }
}

TEST(Pupil, AxialIrradianceIsPiSinSquared) {
  const Setting s = setting("pecs_lab_15mm");
  const ExactPupil pupil = exact_pupil(s.tracer, s.film_z, 0);
  const double tan = pupil.edge_mm[0] / (s.film_z - s.tracer.rear_z_mm()), sin2 = tan * tan / (1 + tan * tan);
  EXPECT_NEAR(pupil.irradiance_per_radiance / (std::numbers::pi * sin2), 1.0, 1e-8);
}

TEST(Pupil, NoLightBeyondTheImageCircle) {
  const Setting s = setting("dgauss_50mm_tronnier");
  EXPECT_EQ(exact_pupil(s.tracer, s.film_z, 80).area_mm2, 0);
}

}  // namespace
}  // namespace pecs::lens
