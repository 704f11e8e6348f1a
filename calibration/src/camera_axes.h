#pragma once
// Rotations between the axes of align.h: the world's, Blender's camera's and OpenCV's (optics.h). A rotation is an
// angle-axis vector [rad], from the axes of the unrotated camera, which looks along the world's +y, to the camera's.
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "degree.h"
#include "pecs/calibration/optics.h"

namespace pecs::calibration {

// World (x right, y forward, z up) to the axes of a camera that looks along +y.
inline const cv::Matx33d kCameraFromWorld(1, 0, 0, 0, 0, -1, 0, 1, 0);
inline const cv::Matx33d kBlenderFromCamera(1, 0, 0, 0, -1, 0, 0, 0, -1);

inline cv::Matx33d matrix_of(const cv::Vec3d& rotation) {
  cv::Matx33d r;
  cv::Rodrigues(rotation, r);
  return r;
}

inline cv::Vec3d rotation_of(const cv::Matx33d& r) {
  cv::Vec3d rotation;
  cv::Rodrigues(r, rotation);
  return rotation;
}

// Euler XYZ (R = Rz Ry Rx) of Blender's camera object.
inline cv::Vec3d blender_rotation_deg(const cv::Vec3d& rotation) {
  const cv::Matx33d r =
      (matrix_of(rotation) * kCameraFromWorld).t() * kBlenderFromCamera;  // world from Blender's camera
  return cv::Vec3d(std::atan2(r(2, 1), r(2, 2)), std::asin(std::clamp(-r(2, 0), -1.0, 1.0)),
                   std::atan2(r(1, 0), r(0, 0))) /
         kDegree;
}

inline cv::Vec3d rotation_from_blender(const cv::Vec3d& rotation_deg) {
  const auto about = [](int axis, double deg) {
    cv::Vec3d v(0, 0, 0);
    v[axis] = deg * kDegree;
    return matrix_of(v);
  };
  const cv::Matx33d r = about(2, rotation_deg[2]) * about(1, rotation_deg[1]) * about(0, rotation_deg[0]);
  return rotation_of((r * kBlenderFromCamera).t() * kCameraFromWorld.t());
}

// A point at (right, down, forward) in the axes of the unrotated camera.
inline cv::Point2d project(const Optics& optics, const cv::Matx33d& rotation, double right, double down,
                           double forward) {
  return optics.project(cv::Point3d(rotation * cv::Vec3d(right, down, forward)));
}

}  // namespace pecs::calibration
