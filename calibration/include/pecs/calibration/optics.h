#pragma once
// Projection of directions to the picture: by a lens prescription, or by OpenCV's camera models.
//
// Camera axes as OpenCV's: x right, y down, z forward, origin at the entrance pupil. Picture coordinates: pixel (0, 0)
// has its centre at (0.5, 0.5).
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "pecs/strict_json.h"

namespace pecs::calibration {

// Rotationally symmetric: radius [px] over the field angle, at equal steps from 0.
struct Optics {
  cv::Point2d axis_px;
  double step_rad = 0;
  std::vector<double> radius_px;
  double focal_px() const { return radius_px[1] / step_rad; }
  double radius_at(double angle_rad) const;  // linear beyond the end
  double angle_at(double radius) const;
  cv::Point2d project(const cv::Point3d& p) const;
  cv::Point2d normalised(const cv::Point2d& pixel) const;  // (x/z, y/z) of the direction of that pixel
};

struct LensSetting {
  std::string lens;  // name or file (lens_data)
  std::optional<double> focus_m, stop_diameter_mm;
  double pixel_pitch_um = 4.86;
  double lambda_nm = 550;
};
// From chief rays (pecs::lens), with the axis at the centre of the picture. Throws bad_input when no rays reach the
// corner.
Optics optics_of(const LensSetting& setting, cv::Size size);

// OpenCV's models, fx = fy = focal. Radial coefficients k1, k2, ...; tangential p1, p2 (pinhole) are not in Optics.
struct CameraModel {
  bool fisheye = false;
  cv::Size size;
  double focal_px = 0;
  cv::Point2d principal_px;
  std::vector<double> radial;  // pinhole: up to 3; fisheye: 4
  cv::Point2d tangential;
};
Optics optics_of(const CameraModel& camera);
Json to_json(const CameraModel& camera);
CameraModel camera_from(JsonObject json);

}  // namespace pecs::calibration
