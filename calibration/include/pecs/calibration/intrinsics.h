#pragma once
// A camera from many views of a board (Zhang's method; OpenCV's calibrateCamera and fisheye::calibrate).
#include "pecs/calibration/board.h"
#include "pecs/calibration/optics.h"

namespace pecs::calibration {

struct IntrinsicsOptions {
  bool fisheye = false;
  int radial = 2;           // coefficients, 0 to 3 (fisheye: always 4)
  bool tangential = false;  // also p1, p2; fisheye has none
};

struct Intrinsics {
  CameraModel camera, deviation;      // deviation: standard deviations by the jackknife over views
  double rms_px = 0;                  // over all points and both coordinates
  std::vector<double> view_rms_px;    // NaN for a discarded view
  std::vector<std::string> warnings;  // discarded views with the reason; parameters that the views do not determine
  std::vector<cv::Vec3d> rotation, at_mm;  // of the board in the camera, per view (Rodrigues)
  double coverage = 0;                     // fraction of the picture's 8 x 6 cells that contain points
};

// Throws bad_input for fewer than 4 views, or when they do not determine a camera.
Intrinsics intrinsics_of(const std::vector<std::vector<cv::Point2d>>& views, const BoardShape& shape, cv::Size size,
                         const IntrinsicsOptions& options, const std::string& file);

// Distortion of the prescription and of the measurement at equal steps of the field angle. Radii in px; the last column
// is their difference after scaling the measured focal length to the predicted one: the error of the shape alone.
struct CurveRow {
  double angle_deg, predicted_px, measured_px, shape_difference_px;
};
std::vector<CurveRow> compare_curves(const Optics& predicted, const Optics& measured, cv::Size size);

Json to_json(const Intrinsics& intrinsics);

// The points with residuals magnified 50 times; below, with `curve`, both distortions over the field.
cv::Mat coverage_picture(const std::vector<std::vector<cv::Point2d>>& views, const Intrinsics& intrinsics,
                         const BoardShape& shape, const std::vector<CurveRow>& curve);

}  // namespace pecs::calibration
