#include <ceres/ceres.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "camera_axes.h"
#include "disk_parts.h"
#include "find_target.h"
#include "pecs/error.h"

namespace pecs::calibration {
namespace {

struct DiskPose {
  std::array<double, 5> p{};  // rotation about x and y [rad]; right, up, distance [mm]
  cv::Matx33d base;           // the scene's rotation, applied first
  cv::Matx33d rotation() const { return matrix_of({p[0], p[1], 0}) * base; }
};

// The plane of the disk as seen by a camera perpendicular to it, from the distance of `scale_mm`.
struct Plane {
  const Optics& optics;
  DiskPose pose;
  double px_per_mm;
  cv::Matx33d rotation = pose.rotation();

  cv::Point2d of(const cv::Point2d& pixel) const {
    const cv::Point2d n = optics.normalised(pixel);
    const cv::Vec3d d = rotation.t() * cv::Vec3d(n.x, n.y, 1);
    return optics.axis_px + cv::Point2d(d[0], d[1]) * (pose.p[4] / d[2] * px_per_mm);
  }
  cv::Point2d pixel(const cv::Point2d& on_plane) const {
    const cv::Point2d mm = (on_plane - optics.axis_px) / px_per_mm;
    return project(optics, rotation, mm.x, mm.y, pose.p[4]);
  }
};

// Residuals of rim and centre: of the scene's disk under a pose, projected to the plane of an earlier pose, minus the
// measured ones.
struct DiskError {
  const Plane& plane;
  const DetectedDisk& disk;
  double radius_mm;
  static constexpr int kRim = 36;

  bool operator()(const double* p, double* error) const {
    DiskPose pose = plane.pose;
    std::copy_n(p, 5, pose.p.begin());
    const cv::Matx33d rotation = pose.rotation();
    const auto place = [&](double u, double v) {
      return plane.of(project(plane.optics, rotation, pose.p[2] + u, -pose.p[3] + v, pose.p[4]));
    };
    const cv::Point2d centre = place(0, 0);
    error[0] = (centre.x - disk.centre_x.value) / std::hypot(disk.centre_x.deviation, 0.02);
    error[1] = (centre.y - disk.centre_y.value) / std::hypot(disk.centre_y.deviation, 0.02);
    for (int i = 0; i < kRim; ++i) {
      const double angle = 2 * CV_PI * i / kRim;
      const cv::Point2d rim = place(radius_mm * std::cos(angle), radius_mm * std::sin(angle));
      error[2 + i] = calibration::disk::off_ellipse_px(disk.rim, rim) / std::max(0.05, disk.rim_rms_px) * 0.6;
    }
    return true;
  }
};

// Initial guess from the rim, for a disk perpendicular to the optical axis.
DiskPose guessed(const Plane& plane, const DetectedDisk& disk, double radius_mm) {
  DiskPose next = plane.pose;
  const double radius = (disk.rim.size.width + disk.rim.size.height) / 4;
  next.p[4] = plane.pose.p[4] * radius_mm * plane.px_per_mm / radius;
  const double mm_per_px = next.p[4] / plane.pose.p[4] / plane.px_per_mm;
  next.p[2] = (disk.centre_x.value - plane.optics.axis_px.x) * mm_per_px;
  next.p[3] = -(disk.centre_y.value - plane.optics.axis_px.y) * mm_per_px;
  return next;
}

// Fits the pose to the measured rim and centre; returns the standard deviation of each parameter.
std::map<std::string, double> refine(DiskPose& pose, const Plane& plane, const DetectedDisk& disk, double radius_mm,
                                     bool hold_camera) {
  ceres::Problem problem;
  problem.AddResidualBlock(new ceres::NumericDiffCostFunction<DiskError, ceres::CENTRAL, DiskError::kRim + 2, 5>(
                               new DiskError{plane, disk, radius_mm}),
                           nullptr, pose.p.data());
  if (hold_camera) problem.SetManifold(pose.p.data(), new ceres::SubsetManifold(5, {0, 1}));
  ceres::Solver::Options options;
  options.logging_type = ceres::SILENT;
  options.max_num_iterations = 100;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);

  std::map<std::string, double> deviation;
  ceres::Covariance::Options c;
  c.algorithm_type = ceres::DENSE_SVD;
  ceres::Covariance covariance(c);
  const std::vector<std::pair<const double*, const double*>> wanted = {{pose.p.data(), pose.p.data()}};
  if (!covariance.Compute(wanted, &problem)) return deviation;
  std::array<double, 25> v;
  covariance.GetCovarianceBlock(pose.p.data(), pose.p.data(), v.data());
  const char* names[] = {"turn_x_deg", "turn_y_deg", "disk_right_mm", "disk_up_mm", "disk_distance_mm"};
  for (std::size_t i = 0; i < 5; ++i) deviation[names[i]] = std::sqrt(v[6 * i]) / (i < 2 ? kDegree : 1);
  return deviation;
}

Json residual_of(const DetectedDisk& disk, const Plane& plane, double radius_mm) {
  const cv::Point2d centre = plane.pixel({disk.centre_x.value, disk.centre_y.value});
  return {
      {"centre_px", {centre.x, centre.y}},
      {"rim_off_centre_px",
       std::hypot(disk.rim.center.x - disk.centre_x.value, disk.rim.center.y - disk.centre_y.value)},
      {"rim_radius_off_px", (disk.rim.size.width + disk.rim.size.height) / 4 - radius_mm * plane.px_per_mm},
      {"rim_axes_difference_px", std::abs(disk.rim.size.width - disk.rim.size.height) / 2},
      {"rim_rms_px", disk.rim_rms_px},
      {"opposite_edges_off_deg",
       std::remainder(disk.off_edge_deg.value - disk.on_edge_deg.value - 360.0 / disk.sectors, 720.0 / disk.sectors)}};
}

}  // namespace

TargetEstimate find_turning_disk(const events::Recording& recording, const LabScene& scene, const Optics& optics,
                                 const Search& how, const std::string& file) {
  const double radius_mm = scene.values.at("disk_radius_mm");
  TargetEstimate found;
  const std::int64_t middle_us = recording.first_us + recording.span_us / 2;
  found.time_us = static_cast<double>(middle_us);
  Plane plane{optics, {{0, 0, 0, 0, scene.position_mm()[2]}, matrix_of(rotation_from_blender(scene.rotation_deg))}, 0};
  plane.px_per_mm = optics.focal_px() / plane.pose.p[4];
  DetectedDisk disk;
  constexpr int kPasses = 3;
  for (int pass = 0; pass < kPasses; ++pass) {
    disk = find_disk(recording, file, [&](const cv::Point2d& p) { return plane.of(p); });
    if (disk.rim.size.width <= 0)
      throw bad_input(file, "disk", "a disk whose rim is not in view",
                      "a visible rim, which the distance is estimated from");
    if (pass + 1 == kPasses) break;  // the last pass uses the final pose
    DiskPose next = pass == 0 ? guessed(plane, disk, radius_mm) : plane.pose;
    found.deviation = refine(next, plane, disk, radius_mm, how.hold_camera);
    plane.pose = next, plane.rotation = next.rotation();
  }
  if (disk.sectors != static_cast<int>(scene.values.at("sectors")))
    throw bad_input(file, "disk", fmt::format("a disk of {} sectors", disk.sectors),
                    fmt::format("{:.0f} sectors, as in the scene", scene.values.at("sectors")));
  found.rotation = rotation_of(plane.pose.rotation());
  found.position_mm = {plane.pose.p[2], plane.pose.p[3], plane.pose.p[4]};
  // The phase is that of the white sector's edge that leads in counter-clockwise rotation; clockwise it trails and
  // darkens.
  found.motion =
      DiskMotion{(disk.speed_deg_s.value > 0 ? disk.on_edge_deg : disk.off_edge_deg).value, disk.speed_deg_s.value};
  found.deviation["phase_deg"] =
      std::hypot(disk.on_edge_deg.deviation, disk.speed_deg_s.deviation * found.time_us * 1e-6);
  found.deviation["rpm"] = disk.speed_deg_s.deviation / 6;
  found.warnings = disk.warnings;
  found.residual = residual_of(disk, plane, radius_mm);
  return found;
}

}  // namespace pecs::calibration
