#pragma once
// The steps of find_disk. Angles, as in disk.h: degrees, counter-clockwise on screen.
#include <array>
#include <cmath>
#include <numbers>
#include <span>
#include <vector>

#include "degree.h"
#include "pecs/calibration/disk.h"

namespace pecs::calibration::disk {

inline constexpr double kLeastRadius_px = 10;  // angles closer to the centre are too uncertain

struct Sample {
  double x, y, t_s;  // pixel centre; time from the middle of the recording
  int p;
};

// Parameters of a fit: centre, speed and the phases of the two sharp steps (ON events', OFF events').
using Fit = std::array<double, 5>;
enum { kX, kY, kSpeed, kOnStep, kOffStep };

inline double wrapped(double angle_deg, double period_deg) {  // to [-period/2, period/2)
  return angle_deg - period_deg * std::floor(angle_deg / period_deg + 0.5);
}

// Angle in the frame that turns with the disk.
inline double phase_deg(const Sample& s, double x, double y, double speed_deg_s) {
  return std::atan2(y - s.y, s.x - x) / kDegree - speed_deg_s * s.t_s;
}

// Distance of a point to an ellipse, about: negative inside.
inline double off_ellipse_px(const cv::RotatedRect& ellipse, const cv::Point2d& p) {
  const double a = ellipse.angle * kDegree, dx = p.x - ellipse.center.x, dy = p.y - ellipse.center.y;
  const double u = (dx * std::cos(a) + dy * std::sin(a)) / (ellipse.size.width / 2);
  const double v = (-dx * std::sin(a) + dy * std::cos(a)) / (ellipse.size.height / 2);
  return (std::hypot(u, v) - 1) * (ellipse.size.width + ellipse.size.height) / 4;
}

// ---- disk_edges.cpp: the sharp steps of the event density in the turning frame

struct Step {
  double phase_deg = 0, sign = 0, contrast = 0;  // sign +1: density is higher at larger phase
};
std::array<Step, 2> steepest(std::span<const Sample> samples, const Fit& fit, double period_deg, double width_deg);
std::vector<Sample> near_steps(std::span<const Sample> samples, const Fit& fit, double period_deg, double width_deg);
// Fits all five parameters so that the two steps are steepest.
Fit sharpened(std::span<const Sample> near, const Fit& start, const std::array<Step, 2>& steps, double period_deg,
              double width_deg, double span_s);
// Fast pixels respond to an edge with a short burst that begins when the blurred edge reaches them: a constant number
// of pixels before its middle, i.e. an angle proportional to 1 / radius. Returns the onset extrapolated to infinite
// radius, in degrees behind the step, and its deviation.
Measured burst_begins(std::span<const Sample> samples, const Fit& fit, int p, double period_deg);

// ---- disk_rim.cpp

// Sets the rim of `disk`. `picture`: outline of the field of view; events that end there are not the rim.
void find_rim(std::span<const Sample> samples, const std::vector<cv::Point2f>& picture, DetectedDisk& disk);

}  // namespace pecs::calibration::disk
