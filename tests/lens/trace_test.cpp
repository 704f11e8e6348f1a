#include "pecs/lens/trace.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "lenses.h"
#include "pecs/lens/first_order.h"
#include "pecs/strict_json.h"

namespace pecs::lens {
namespace {

Surface surface(double radius, double z, double semi, Glass after) {
  Surface s;
  s.curvature = radius == 0 ? 0 : 1 / radius;
  s.z_mm = z;
  s.semi_diameter_mm = semi;
  s.after = std::move(after);
  return s;
}

Prescription slab(double n, double thickness) {
  Prescription lens;
  lens.file = "slab";
  lens.surfaces = {surface(0, 0, 50, Glass::constant(n, "")), surface(0, thickness, 50, Glass::air())};
  return lens;
}

TEST(Trace, SnellAtAPlane) {
  const Prescription lens = slab(1.5, 10);
  const Tracer tracer(lens, 550);
  const double angle = 0.6, inside = std::asin(std::sin(angle) / 1.5);
  std::vector<Vec3> hits;
  const Traced t = tracer.to_film({{0, 0, -1}, {std::sin(angle), 0, std::cos(angle)}}, Tracer::Clip::housing, &hits);
  ASSERT_EQ(t.fate, Fate::ok);
  ASSERT_EQ(hits.size(), 2u);
  EXPECT_NEAR(hits[0].x, std::tan(angle), 1e-14);
  EXPECT_NEAR(hits[1].x - hits[0].x, 10 * std::tan(inside), 1e-13);
  EXPECT_NEAR(t.ray.d.x, std::sin(angle), 1e-15);  // a slab changes no direction
}

TEST(Trace, AplanaticPointsOfASphere) {
  // A ray aimed at distance n R beyond the centre leaves a sphere aimed at R / n, exactly.
  const double radius = 10, n = 1.7;
  Prescription lens;
  lens.surfaces = {surface(radius, 0, 9.9, Glass::constant(n, ""))};
  const Tracer tracer(lens, 550);
  for (const double h : {0.5, 3.0, 6.0, 8.0}) {
    const Vec3 target{0, 0, radius + n * radius}, start{h * 2.0, 0, -20};
    const Traced t = tracer.to_film({start, normalized(target - start)});
    ASSERT_EQ(t.fate, Fate::ok) << h;
    EXPECT_NEAR(t.ray.at_z(radius + radius / n).x, 0, 1e-12) << h;
  }
}

TEST(Trace, ConicsFocusWithoutAberration) {
  // An ellipsoid of k = -1/n^2 focuses a parallel beam exactly at f = n R / (n - 1).
  const double n = 1.5, radius = 20;
  Prescription lens;
  lens.surfaces = {surface(radius, 0, 12, Glass::constant(n, ""))};
  lens.surfaces[0].conic = -1 / (n * n);
  const Tracer tracer(lens, 550);
  for (const double h : {1.0, 5.0, 11.0}) {
    const Traced t = tracer.to_film({{0, h, -5}, {0, 0, 1}});
    ASSERT_EQ(t.fate, Fate::ok);
    EXPECT_NEAR(t.ray.at_z(n * radius / (n - 1)).y, 0, 1e-12) << h;
  }
}

TEST(Trace, APolynomialThatIsAParabolaTracesAsTheConic) {
  Prescription conic, poly;
  conic.surfaces = {surface(16, 0, 8, Glass::constant(1.6, ""))};
  conic.surfaces[0].conic = -1;  // a paraboloid: sag = r^2 / (2 R)
  poly.surfaces = {surface(0, 0, 8, Glass::constant(1.6, ""))};
  poly.surfaces[0].powers = {0, 0, 1.0 / 32.0};
  const Ray ray{{7, 2, -3}, normalized({-0.2, 0.1, 1})};
  const Traced a = Tracer(conic, 550).to_film(ray), b = Tracer(poly, 550).to_film(ray);
  ASSERT_EQ(a.fate, Fate::ok);
  ASSERT_EQ(b.fate, Fate::ok);
  EXPECT_NEAR(a.ray.p.x, b.ray.p.x, 1e-12);
  EXPECT_NEAR(a.ray.d.x, b.ray.d.x, 1e-12);
  EXPECT_NEAR(a.ray.d.y, b.ray.d.y, 1e-12);
}

TEST(Trace, FatesNameTheSurface) {
  Prescription lens = slab(1.5, 10);
  lens.surfaces[1].semi_diameter_mm = 1;
  EXPECT_EQ(fate_text(Tracer(lens, 550).to_film({{2, 0, -1}, {0, 0, 1}})), "clipped:1");
  EXPECT_EQ(fate_text(Tracer(lens, 550).to_film({{2, 0, -1}, {0, 0, 1}}, Tracer::Clip::none)), "ok");
  Prescription ball;
  ball.surfaces = {surface(5, 0, 4.9, Glass::constant(1.5, "")), surface(-5, 8, 4.9, Glass::air())};
  EXPECT_EQ(fate_text(Tracer(ball, 550).to_film({{6, 0, -1}, {0, 0, 1}})), "missed:0");
  Prescription prism;  // from glass to air at 45 degrees and more
  prism.surfaces = {surface(0, 0, 50, Glass::constant(1.8, "")), surface(-7, 9, 6.9, Glass::air())};
  EXPECT_EQ(fate_text(Tracer(prism, 550).to_film({{5.5, 0, -1}, {0, 0, 1}})), "tir:1");
}

struct EveryTrace : tests::EveryLens {};

TEST_P(EveryTrace, TracingBackReturnsTheRay) {
  const Prescription lens = load_prescription(GetParam());
  const FirstOrder f = first_order(lens, kLambdaD);
  const Tracer tracer(lens, kLambdaD);
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(-1, 1);
  int passed = 0;
  for (int i = 0; i < 400; ++i) {
    const Vec3 aim{0.5 * f.entrance_pupil_diameter_mm * unit(random), 0.5 * f.entrance_pupil_diameter_mm * unit(random),
                   f.entrance_pupil_z_mm};
    const Ray ray{aim, normalized({0.02 * unit(random), 0.02 * unit(random), 1})};
    const Traced there = tracer.to_film(ray);
    if (there.fate != Fate::ok) continue;
    const Traced back = tracer.to_scene({there.ray.p, -1.0 * there.ray.d});
    ASSERT_EQ(back.fate, Fate::ok);
    EXPECT_NEAR(back.ray.at_z(aim.z).x, aim.x, 1e-9);
    EXPECT_NEAR(back.ray.at_z(aim.z).y, aim.y, 1e-9);
    EXPECT_NEAR(back.ray.d.x, -ray.d.x, 1e-11);
    ++passed;
  }
  EXPECT_GT(passed, 50);
}
PECS_EVERY_LENS(EveryTrace);

struct ReferenceRays : testing::TestWithParam<const char*> {};

TEST_P(ReferenceRays, AgreeWithTwoIndependentTracers) {
  const std::string name = GetParam(), rays_file = "lenses/rays/rays_" + name + ".json";
  PECS_NEEDS_SHARED(rays_file);
  const Prescription lens = load_prescription((pecs::tests::shared_dir() / "lenses" / (name + ".json")).string());
  const Json json = parse_json_file(pecs::tests::shared_dir() / rays_file);
  const double image_z = json["z_image_plane"];
  int count = 0, passing = 0;
  for (const Json& row : json["rays"]) {
    const double um = row["lam"];
    std::vector<double> n;
    for (const auto& [key, list] : json["indices"].items())
      if (std::abs(std::stod(key) - um) < 1e-9) n = list.get<std::vector<double>>();
    if (n.size() == lens.surfaces.size() - 1) n.push_back(1.0);
    ASSERT_EQ(n.size(), lens.surfaces.size());
    const Tracer tracer(lens, n);
    const auto vec = [](const Json& v) { return Vec3{v[0], v[1], v[2]}; };
    const Ray ray{vec(row["p0"]), vec(row["d0"])};
    const Traced t = tracer.to_film(ray, Tracer::Clip::none);
    ASSERT_EQ(t.fate, Fate::ok);
    const Vec3 at = t.ray.at_z(image_z);
    EXPECT_NEAR(at.x, row["final_xy"][0].get<double>(), 1e-9);
    EXPECT_NEAR(at.y, row["final_xy"][1].get<double>(), 1e-9);
    EXPECT_NEAR(t.ray.d.x, row["final_dir"][0].get<double>(), 1e-12);
    EXPECT_NEAR(t.ray.d.y, row["final_dir"][1].get<double>(), 1e-12);
    const bool passes = tracer.to_film(ray).fate == Fate::ok;
    EXPECT_EQ(passes, row["passes"].get<bool>());
    passing += passes;
    ++count;
  }
  EXPECT_EQ(count, 324);
  EXPECT_GT(passing, 100);
}
INSTANTIATE_TEST_SUITE_P(Shared, ReferenceRays,
                         testing::Values("singlet_planoconvex_nbk7_50mm", "dgauss_50mm_tronnier",
                                         "cmount_16mm_f2p1_us8427765"),
                         [](const auto& param_info) { return std::string(param_info.param); });

}  // namespace
}  // namespace pecs::lens
