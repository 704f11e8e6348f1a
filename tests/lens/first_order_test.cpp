#include "pecs/lens/first_order.h"

#include <gtest/gtest.h>

#include "lenses.h"
#include "pecs/error.h"
#include "pecs/lens/pupil.h"

namespace pecs::lens {
namespace {

// EFL, BFL [mm] and f-number at the d line, by rayoptics and optiland (shared/lens_notes.md, section 3).
struct Known {
  const char* name;
  double efl, bfl, fnumber;
};
struct KnownLens : testing::TestWithParam<Known> {};

TEST_P(KnownLens, FocalLengths) {
  const Known known = GetParam();
  const std::string file = std::string("lenses/") + known.name + ".json";
  PECS_NEEDS_SHARED(file);
  const FirstOrder f = first_order(load_prescription((pecs::tests::shared_dir() / file).string()), kLambdaD);
  EXPECT_NEAR(f.efl_mm, known.efl, 1e-5 * known.efl + 3e-4);
  EXPECT_NEAR(f.bfl_mm, known.bfl, 1e-5 * known.efl + 3e-4);
  EXPECT_NEAR(f.fnumber, known.fnumber, 0.006);
}
INSTANTIATE_TEST_SUITE_P(Table, KnownLens,
                         testing::Values(Known{"dgauss_50mm_tronnier", 50.358, 36.106, 2.03},
                                         Known{"singlet_planoconvex_nbk7_50mm", 49.9999967, 47.3628659, 5.0},
                                         Known{"cmount_8mm_f2p8_nikon_retro", 8.005, 10.468, 2.8},
                                         Known{"cmount_16mm_f2p1_us8427765", 15.9999886, 11.1393540, 2.11},
                                         Known{"double_gauss_100mm_28deg", 100.004, 61.488, 3.10},
                                         Known{"angenieux_100mm_f1p1", 99.94, 55.977, 1.14}),
                         [](const auto& param_info) { return std::string(param_info.param.name); });

TEST(FirstOrder, TheLabLens) {  // facts.md: EFL 15.02, BFL 10.24, F/4.15 open, F/18.8 at 1.0 mm
  const Prescription lens = load_prescription("pecs_lab_15mm");
  const FirstOrder open = first_order(lens, kLambdaD), closed = first_order(lens, kLambdaD, 1.0);
  EXPECT_NEAR(open.efl_mm, 15.02, 0.005);
  EXPECT_NEAR(open.bfl_mm, 10.24, 0.005);
  EXPECT_NEAR(open.fnumber, 4.15, 0.005);
  EXPECT_NEAR(closed.fnumber, 18.8, 0.05);
}

TEST(FirstOrder, StopByFnumber) {
  const Prescription lens = load_prescription("dgauss_50mm_tronnier");
  EXPECT_NEAR(first_order(lens, kLambdaD, stop_diameter_for_fnumber(lens, 5.6)).fnumber, 5.6, 1e-12);
  EXPECT_THROW(stop_diameter_for_fnumber(lens, 1.4), Error);
}

struct EveryFirstOrder : tests::EveryLens {};

TEST_P(EveryFirstOrder, RealRaysNearTheAxisMeetTheParaxialFocus) {
  const Prescription lens = load_prescription(GetParam());
  const FirstOrder f = first_order(lens, 550);
  const Tracer tracer(lens, 550);
  const double h = 1e-4 * f.efl_mm;
  const Traced t = tracer.to_film({{h, 0, -1}, {0, 0, 1}});
  ASSERT_EQ(t.fate, Fate::ok);
  EXPECT_NEAR(-t.ray.at_z(lens.rear_z_mm()).x / (t.ray.d.x / t.ray.d.z) / f.bfl_mm, 1.0, 1e-6);
  EXPECT_NEAR(-h / (t.ray.d.x / t.ray.d.z) / f.efl_mm, 1.0, 1e-6);
}

TEST_P(EveryFirstOrder, BestFocusIsTheLeastSpot) {
  const Prescription lens = load_prescription(GetParam());
  const double bands[] = {450, 550, 650};
  for (const std::optional<double> distance : {std::optional<double>(), std::optional<double>(3.0)}) {
    const Focus focus = best_focus(lens, bands, distance);
    // The spot by brute force: rays on a grid of the entrance pupil, over film positions around the focus found.
    const auto rms = [&](double film_z) {
      double sum = 0;
      int count = 0;
      for (const double lambda : bands) {
        const Tracer tracer(lens, lambda);
        const FirstOrder f = first_order(lens, lambda);
        for (int i = -30; i <= 30; ++i)
          for (int j = -30; j <= 30; ++j) {
            const double x = i / 60.0 * f.entrance_pupil_diameter_mm * 1.2,
                         y = j / 60.0 * f.entrance_pupil_diameter_mm * 1.2;
            const Traced t =
                tracer.to_film(ray_from_axis(distance, f.entrance_pupil_z_mm, x, y, f.entrance_pupil_z_mm));
            if (t.fate != Fate::ok) continue;
            const Vec3 p = t.ray.at_z(film_z);
            sum += p.x * p.x + p.y * p.y;
            ++count;
          }
      }
      return std::sqrt(sum / count);
    };
    const double at = rms(focus.film_z_mm), step = 0.005 * focus.film_z_mm;
    EXPECT_NEAR(at / focus.rms_spot_mm, 1.0, 0.12);
    EXPECT_GT(rms(focus.film_z_mm + step), at);
    EXPECT_GT(rms(focus.film_z_mm - step), at);
  }
}
PECS_EVERY_LENS(EveryFirstOrder);

}  // namespace
}  // namespace pecs::lens
