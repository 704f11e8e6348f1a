// A diaphragm whose plane intersects its curved neighbour, compared with the same lens with a free diaphragm.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "lenses.h"
#include "pecs/error.h"
#include "pecs/lens/exchange.h"
#include "pecs/lens/field.h"

namespace pecs::lens {
namespace {

struct Moved {
  const char *cuts, *open;  // the test's file, and the lens of lens_data it is derived from
};

struct StopPlane : testing::TestWithParam<Moved> {
  Prescription cuts = load_prescription((tests::test_lens_dir() / GetParam().cuts).string());
  Prescription open = load_prescription(GetParam().open);
};

TEST_P(StopPlane, JudgesARayByItsLineBetweenTheNeighbours) {
  const Tracer cut(cuts, 550), whole(open, 550);
  const std::size_t stop = cuts.stop;
  const double plane = cuts.surfaces[stop].z_mm, semi = cuts.surfaces[stop].semi_diameter_mm;
  const FirstOrder f = first_order(cuts, 550);
  std::mt19937 random(3);
  std::uniform_real_distribution<double> unit(-1, 1);
  int backward = 0, passing = 0, blocked = 0;
  for (int i = 0; i < 4000; ++i) {
    const double reach = 0.6 * f.entrance_pupil_diameter_mm;
    const Ray ray{{reach * unit(random), reach * unit(random), f.entrance_pupil_z_mm},
                  normalized({0.15 * unit(random), 0.15 * unit(random), 1})};
    std::vector<Vec3> hits, open_hits;
    const Traced there = cut.to_film(ray, Tracer::Clip::none, &hits);
    const Traced expected = whole.to_film(ray, Tracer::Clip::none, &open_hits);
    ASSERT_EQ(there.fate, expected.fate);
    if (there.fate != Fate::ok) continue;
    EXPECT_NEAR(there.ray.at_z(plane).x, expected.ray.at_z(plane).x, 1e-10);
    EXPECT_NEAR(there.ray.d.x, expected.ray.d.x, 1e-13);
    backward += hits[stop].z < hits[stop - 1].z || hits[stop + 1].z < hits[stop].z;

    // Expected: the line between the hits on both neighbours, at the plane of the stop; glass rims block as usual.
    const Ray line{open_hits[stop - 1], normalized(open_hits[stop + 1] - open_hits[stop - 1])};
    const Vec3 at = line.at_z(plane);
    EXPECT_NEAR(at.x, hits[stop].x, 1e-10);
    bool passes = std::hypot(at.x, at.y) <= semi;
    for (std::size_t s = 0; s < hits.size(); ++s)
      if (s != stop) passes = passes && std::hypot(open_hits[s].x, open_hits[s].y) <= open.surfaces[s].semi_diameter_mm;
    EXPECT_EQ(cut.to_film(ray).fate == Fate::ok, passes);
    EXPECT_EQ(cut.to_scene({there.ray.p, -1.0 * there.ray.d}).fate == Fate::ok, passes);
    (passes ? passing : blocked)++;
  }
  EXPECT_GT(backward, 1000);
  EXPECT_GT(passing, 1000);
  EXPECT_GT(blocked, 500);
}

// With a stop that blocks nothing both lenses have one pupil, so one wavefront: a step back counts as less path.
TEST_P(StopPlane, LeavesTheWavefrontAlone) {
  cuts.surfaces[cuts.stop].semi_diameter_mm = open.surfaces[open.stop].semi_diameter_mm = 1e3;
  const double bands[] = {550};
  const Focus focus = best_focus(open, bands, std::nullopt);
  const auto curve = [&](const Prescription& lens, double r) {
    const Tracer tracer(lens, 550);
    const ObjectPoint axis{true, {0, 0, 1}};
    return wavefront_mtf(lens, tracer, axis, focus, r, 100);
  };
  const MtfCurve a = curve(cuts, 0), b = curve(open, 0);
  ASSERT_GT(a.tangential.size(), 10u);
  ASSERT_EQ(a.tangential.size(), b.tangential.size());
  for (std::size_t i = 0; i < a.tangential.size(); ++i) EXPECT_NEAR(a.tangential[i], b.tangential[i], 1e-6) << i;
}

TEST_P(StopPlane, IsDrawnWithRaysThatGoForward) {
  const double bands[] = {550};
  const Focus focus = best_focus(cuts, bands, std::nullopt);
  const auto fan = ray_fan(Tracer(cuts, 550), cuts.stop, focus.film_z_mm, 1.0, 7, 10);
  ASSERT_EQ(fan.size(), 7u);
  for (const auto& line : fan)
    for (std::size_t i = 1; i < line.size(); ++i) EXPECT_LT(line[i].z, line[i - 1].z);
}

INSTANTIATE_TEST_SUITE_P(Lenses, StopPlane,
                         testing::Values(Moved{"stop_cuts_next.json", "dgauss_50mm_tronnier"},
                                         Moved{"stop_cuts_previous.json", "cmount_16mm_f2p1"}),
                         [](const auto& param_info) {
                           return std::filesystem::path(param_info.param.cuts).stem().string();
                         });

// pbrt traces rays only forwards.
TEST(AStopPlaneThatCuts, GoesToNoPbrtFile) {
  const Prescription lens = load_prescription((tests::test_lens_dir() / "stop_cuts_next.json").string());
  pecs::tests::expect_error([&] { export_pbrt(lens, 550, 68); }, ExitCode::unsupported, "surfaces[5]");
}

}  // namespace
}  // namespace pecs::lens
