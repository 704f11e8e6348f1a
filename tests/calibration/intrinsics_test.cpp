#include "pecs/calibration/intrinsics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <random>

#include "pecs/error.h"

namespace pecs::calibration {
namespace {

const BoardShape kBoard{Pattern::checkerboard, 8, 6, 30};
const cv::Size kSize(640, 360);

// Views of the board through an Optics, with noise on the points.
std::vector<std::vector<cv::Point2d>> views_of(const Optics& optics, int count, double noise_px) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::normal_distribution<double> noise(0, noise_px);
  std::vector<std::vector<cv::Point2d>> views;
  while (static_cast<int>(views.size()) < count) {
    const cv::Vec3d turn(0.7 * unit(random), 0.7 * unit(random), 0.4 * unit(random));
    cv::Matx33d r;
    cv::Rodrigues(turn, r);
    const double z = 0.5 * optics.focal_px() * (1.5 + 0.4 * unit(random));
    const cv::Vec3d at(unit(random) * z * 240 / optics.focal_px(), unit(random) * z * 100 / optics.focal_px(), z);
    std::vector<cv::Point2d> points;
    bool inside = true;
    for (const auto& p : kBoard.points_mm()) {
      const cv::Vec3d q = r * cv::Vec3d(p) + at;
      points.push_back(optics.project(cv::Point3d(q)));
      inside = inside && points.back().inside(cv::Rect2d(0, 0, kSize.width, kSize.height));
    }
    for (auto& p : points) p += cv::Point2d(noise(random), noise(random));
    if (inside) views.push_back(std::move(points));
  }
  return views;
}

TEST(Intrinsics, APinholeWithDistortionWithinItsDeviations) {
  const CameraModel truth{false, kSize, 700, {326.4, 174.2}, {-0.12, 0.05, 0}, {}};
  const auto views = views_of(optics_of(truth), 15, 0.1);
  const Intrinsics in = intrinsics_of(views, kBoard, kSize, {}, "x");
  EXPECT_NEAR(in.rms_px, 0.1 * std::sqrt(2), 0.02);
  EXPECT_NEAR(in.camera.focal_px, truth.focal_px, 0.003 * truth.focal_px);
  EXPECT_LT(cv::norm(in.camera.principal_px - truth.principal_px), 1.5);
  EXPECT_LT(std::abs(in.camera.focal_px - truth.focal_px), 4 * in.deviation.focal_px);
  for (const auto& row : compare_curves(optics_of(truth), optics_of(in.camera), kSize))
    EXPECT_LT(std::abs(row.shape_difference_px), 0.3) << row.angle_deg;
}

TEST(Intrinsics, AFisheye) {
  const CameraModel truth{true, kSize, 230, {322, 178}, {0.02, -0.01, 0, 0}, {}};
  const Intrinsics in = intrinsics_of(views_of(optics_of(truth), 20, 0.05), kBoard, kSize, {.fisheye = true}, "x");
  EXPECT_NEAR(in.camera.focal_px, truth.focal_px, 0.003 * truth.focal_px);
  EXPECT_LT(cv::norm(in.camera.principal_px - truth.principal_px), 1);
}

TEST(Intrinsics, AnOutlierViewIsDiscardedAndTooFewAreAnError) {
  const CameraModel truth{false, kSize, 700, {320, 180}, {0, 0, 0}, {}};
  auto views = views_of(optics_of(truth), 12, 0.1);
  std::mt19937 random(1);
  for (auto& p : views[5]) p += cv::Point2d(std::normal_distribution(0.0, 8.0)(random), 0);
  const Intrinsics in = intrinsics_of(views, kBoard, kSize, {}, "x");
  EXPECT_TRUE(std::isnan(in.view_rms_px[5]));
  ASSERT_FALSE(in.warnings.empty());
  EXPECT_NE(in.warnings[0].find("view 5 left out"), std::string::npos);
  EXPECT_NEAR(in.camera.focal_px, 700, 5);
  views.resize(3);
  EXPECT_THROW(intrinsics_of(views, kBoard, kSize, {}, "x"), Error);
}

// Near the axis the projection of distant points follows the focal length, and it is invertible.
TEST(Optics, ProjectsThroughALensPrescription) {
  const Optics o = optics_of({.lens = "pecs_lab_15mm", .focus_m = 1.56, .stop_diameter_mm = 1.0}, {1280, 720});
  EXPECT_NEAR(o.focal_px() * 4.86e-3, 15.02 * (1 + 15.02 / 1545), 0.1);  // mm; extended to focus at 1.56 m
  for (const cv::Point2d p : {cv::Point2d(640.4, 359), {3, 4}, {1200, 700}}) {
    const cv::Point2d n = o.normalised(p);
    EXPECT_LT(cv::norm(o.project({n.x, n.y, 1}) - p), 1e-3);
  }
  LensSetting far;
  far.lens = "pecs_lab_15mm";
  EXPECT_THROW(optics_of(far, {12800, 7200}), Error);
}

TEST(Optics, ACameraRoundTripsThroughJson) {
  const CameraModel c{false, kSize, 700.5, {326.4, 174.2}, {-0.12, 0.05, 0.01}, {1e-4, -2e-4}};
  const CameraModel d = camera_from(JsonObject(to_json(c), "x"));
  EXPECT_EQ(to_json(c), to_json(d));
}

}  // namespace
}  // namespace pecs::calibration
