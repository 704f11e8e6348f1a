#include "pecs/lens/field.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "lenses.h"
#include "pecs/lens/diffraction.h"

namespace pecs::lens {
namespace {

struct EveryField : tests::EveryLens {};

TEST_P(EveryField, RowsAreConsistent) {
  const Prescription lens = load_prescription(GetParam());
  const double bands[] = {550};
  const Focus focus = best_focus(lens, bands, std::nullopt);
  const auto rows = field_rows(lens, {550, 650}, 550, kWideOpen, focus, 3.569, 4);
  ASSERT_EQ(rows.size(), 4u);
  EXPECT_NEAR(rows[0].relative_illumination, 1, 1e-12);
  EXPECT_NEAR(rows[0].angle_deg, 0, 1e-6);
  EXPECT_NEAR(rows[0].rms_spot_um[0] / (1e3 * focus.rms_spot_mm), 1, 0.15);
  for (std::size_t i = 1; i < rows.size(); ++i) {
    EXPECT_GT(rows[i].angle_deg, rows[i - 1].angle_deg);
    EXPECT_LE(rows[i].relative_illumination, 1.02);
    EXPECT_NEAR(rows[i].lateral_colour_um[0], 0, 1e-6);  // the reference wavelength
    EXPECT_GT(rows[i].rms_spot_um[1], 0);
  }
}
PECS_EVERY_LENS(EveryField);

TEST(Field, TheEightMillimetreLens) {
  // shared/lens_notes.md, section 3: RI .618, distortion -1.33 % at the corner.
  const Prescription lens = load_prescription("cmount_8mm_f2p8");
  const double bands[] = {kLambdaD};
  const Focus focus = best_focus(lens, bands, std::nullopt);
  const FieldRow corner = field_rows(lens, {450, 650}, 550, kWideOpen, focus, 3.569, 2).back();
  EXPECT_NEAR(corner.relative_illumination, 0.618, 0.01);
  EXPECT_NEAR(corner.distortion_percent, -1.33, 0.02);

  // Lateral colour the other way: parallel light from the scene, the ray that crosses the stop's centre.
  const auto chief = chief_ray(Tracer(lens, 550), lens.stop, focus.film_z_mm, 3.569);
  ASSERT_TRUE(chief);
  const double z = first_order(lens, 550).entrance_pupil_z_mm;
  for (const std::size_t band : {0, 1}) {
    const Tracer tracer(lens, band == 0 ? 450 : 650);
    std::vector<Vec3> hits;
    double low = -1, high = 1;  // on the entrance pupil's plane; the height in the stop rises with it
    for (int i = 0; i < 60; ++i) {
      const double mid = 0.5 * (low + high);
      hits.clear();
      tracer.to_film({{mid, 0, z}, -1.0 * chief->d}, Tracer::Clip::none, &hits);
      ASSERT_GT(hits.size(), lens.stop);
      (hits[lens.stop].x < 0 ? low : high) = mid;
    }
    const double r = tracer.to_film({{low, 0, z}, -1.0 * chief->d}, Tracer::Clip::none).ray.at_z(focus.film_z_mm).x;
    EXPECT_NEAR(1e3 * (r - 3.569), corner.lateral_colour_um[band], 1e-4);
  }
}

MtfCurve mtf_of(const std::string& name, double fnumber, double r_mm, std::optional<double> distance_m = std::nullopt) {
  const Prescription lens = load_prescription(name);
  const double bands[] = {550}, stop = stop_diameter_for_fnumber(lens, fnumber);
  const Focus focus = best_focus(lens, bands, distance_m, stop);
  const Tracer tracer(lens, 550, stop);
  const double pupil_z = first_order(lens, 550, stop).entrance_pupil_z_mm;
  return wavefront_mtf(lens, tracer, *object_point(tracer, lens.stop, focus, pupil_z, r_mm), focus, r_mm, 100);
}

TEST(Field, AGoodSmallApertureReachesTheDiffractionLimit) {
  const Prescription lens = load_prescription("cmount_16mm_f2p1");
  for (const std::optional<double> distance : {std::optional<double>(), std::optional<double>(0.5)}) {
    const double bands[] = {550}, stop = stop_diameter_for_fnumber(lens, 16);
    const Focus focus = best_focus(lens, bands, distance, stop);
    const double e0 = exact_pupil(Tracer(lens, 550, stop), focus.film_z_mm, 0).irradiance_per_radiance;
    const double working = 0.5 / std::sqrt(e0 / std::numbers::pi);
    const MtfCurve curve = mtf_of("cmount_16mm_f2p1", 16, 0, distance);
    ASSERT_GT(curve.cycles_per_mm.size(), 20u);
    for (std::size_t i = 0; i < curve.cycles_per_mm.size(); ++i) {
      const double limit = diffraction_mtf(curve.cycles_per_mm[i], 550, working);
      EXPECT_NEAR(curve.tangential[i], limit, 0.015) << curve.cycles_per_mm[i];
      EXPECT_NEAR(curve.sagittal[i], curve.tangential[i], 1e-3);
    }
  }
}

TEST(Field, LargeAberrationsGiveTheGeometricMtf) {
  const Prescription lens = load_prescription("dgauss_50mm_tronnier");
  const double bands[] = {550};
  const Focus focus = best_focus(lens, bands, std::nullopt);
  const Tracer tracer(lens, 550);
  const double pupil_z = first_order(lens, 550).entrance_pupil_z_mm;
  for (const double r : {0.0, 8.0}) {
    const auto object = object_point(tracer, lens.stop, focus, pupil_z, r);
    const MtfCurve curve = wavefront_mtf(lens, tracer, *object, focus, r, 30);
    const std::vector<Vec3> hits = spot(tracer, tracer, *object, focus, pupil_z, r, 128);
    ASSERT_GT(curve.cycles_per_mm.size(), 5u);
    double least = 1;
    for (std::size_t i = 0; i < curve.cycles_per_mm.size(); ++i) {
      const double f = curve.cycles_per_mm[i];
      const Mtf geometric = geometric_mtf(hits, f);
      EXPECT_NEAR(curve.tangential[i], geometric.tangential, 0.06) << r << ' ' << f;
      EXPECT_NEAR(curve.sagittal[i], geometric.sagittal, 0.06) << r << ' ' << f;
      least = std::min(least, geometric.tangential);
    }
    EXPECT_LT(least, 0.7);  // otherwise there is no aberration to test
  }
}

TEST(Field, MtfOfAPointAndOfAPair) {
  const std::vector<Vec3> one{{0.1, 0.2, 0}}, pair{{-0.01, 0, 0}, {0.01, 0, 0}};
  EXPECT_NEAR(geometric_mtf(one, 30).tangential, 1, 1e-12);
  EXPECT_NEAR(geometric_mtf(pair, 12.5).tangential, std::abs(std::cos(2 * 3.14159265358979 * 12.5 * 0.01)), 1e-9);
  EXPECT_NEAR(geometric_mtf(pair, 12.5).sagittal, 1, 1e-12);
}

}  // namespace
}  // namespace pecs::lens
