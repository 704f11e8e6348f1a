#include "pecs/calibration/optics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "pecs/error.h"
#include "pecs/lens/image_map.h"
#include "pecs/lens/report.h"

namespace pecs::calibration {
namespace {

constexpr int kSteps = 400;

// Resamples radius(angle) at equal angle steps from rows of increasing (angle, radius).
Optics resampled(const std::vector<double>& angle, const std::vector<double>& radius, cv::Point2d axis) {
  Optics o{axis, angle.back() / kSteps, {}};
  std::size_t k = 1;
  for (int i = 0; i <= kSteps; ++i) {
    const double a = i * o.step_rad;
    while (k + 1 < angle.size() && angle[k] < a) ++k;
    // Interpolates the ratio radius / tan(angle), which is nearly constant.
    const auto ratio = [&](std::size_t j) {
      return j == 0 ? radius[1] / std::tan(angle[1]) : radius[j] / std::tan(angle[j]);
    };
    const double t = (a - angle[k - 1]) / (angle[k] - angle[k - 1]);
    o.radius_px.push_back(std::tan(a) * ((1 - t) * ratio(k - 1) + t * ratio(k)));
  }
  return o;
}

}  // namespace

double Optics::radius_at(double angle_rad) const {
  const double at = angle_rad / step_rad;
  const auto i = std::min(static_cast<std::size_t>(at), radius_px.size() - 2);
  return radius_px[i] + (at - static_cast<double>(i)) * (radius_px[i + 1] - radius_px[i]);
}

double Optics::angle_at(double radius) const {
  const auto above = std::upper_bound(radius_px.begin() + 1, radius_px.end() - 1, radius);
  const auto i = static_cast<double>(above - radius_px.begin() - 1);
  return step_rad * (i + (radius - *(above - 1)) / (*above - *(above - 1)));
}

cv::Point2d Optics::project(const cv::Point3d& p) const {
  const double across = std::hypot(p.x, p.y);
  if (across < 1e-12) return axis_px;
  return axis_px + cv::Point2d(p.x, p.y) * (radius_at(std::atan2(across, p.z)) / across);
}

cv::Point2d Optics::normalised(const cv::Point2d& pixel) const {
  const cv::Point2d d = pixel - axis_px;
  const double r = cv::norm(d);
  return r < 1e-9 ? cv::Point2d(0, 0) : d * (std::tan(angle_at(r)) / r);
}

Optics optics_of(const LensSetting& s, cv::Size size) {
  const lens::Prescription prescription = lens::load_prescription(s.lens);
  lens::ImageSetting setting{.width_px = size.width, .height_px = size.height};
  setting.pixel_pitch_mm = s.pixel_pitch_um * 1e-3;
  setting.lambda_nm = s.lambda_nm;
  setting.focus_m = s.focus_m;
  setting.stop_diameter_mm = lens::resolve_stop(prescription, {s.stop_diameter_mm, {}});
  const lens::ImageMap map(prescription, setting);
  const cv::Point2d middle(size.width / 2.0, size.height / 2.0);
  const double corner_px = cv::norm(middle);
  std::vector<double> angle = {0}, radius = {0};
  // Extends the table beyond the corner, for targets that are partly out of view.
  for (int i = 1; i <= kSteps; ++i) {
    const double r = 1.099 * corner_px * i / kSteps;
    const auto d = map.direction_from_pixel({middle.x + r, middle.y});
    if (!d) {
      if (r > corner_px) break;
      throw bad_input(
          s.lens, "field", fmt::format("no chief ray {:.3f} mm off the axis", r * setting.pixel_pitch_mm),
          fmt::format("a lens that covers {} x {} pixels of {} um", size.width, size.height, s.pixel_pitch_um));
    }
    angle.push_back(std::atan2(d->x, d->z)), radius.push_back(r);
  }
  return resampled(angle, radius, middle);
}

Optics optics_of(const CameraModel& c) {
  const double corner = std::hypot(c.size.width, c.size.height) * 0.55;
  std::vector<double> angle = {0}, radius = {0};
  for (double a = 0.002; a < (c.fisheye ? 3.0 : 1.5); a += 0.002) {
    const double x = c.fisheye ? a : std::tan(a);
    double sum = x, power = x;
    for (const double k : c.radial) power *= x * x, sum += k * power;
    if (c.focal_px * sum <= radius.back()) break;  // the polynomial is no longer monotonic
    angle.push_back(a), radius.push_back(c.focal_px * sum);
    if (radius.back() > corner) break;
  }
  if (radius.back() < corner * 0.9)
    throw bad_input("camera", "radial", "a distortion that turns back inside the picture",
                    "one that rises to its corner");
  return resampled(angle, radius, c.principal_px);
}

Json to_json(const CameraModel& c) {
  return {{"model", c.fisheye ? "fisheye" : "pinhole"},
          {"width", c.size.width},
          {"height", c.size.height},
          {"focal_px", c.focal_px},
          {"principal_px", {c.principal_px.x, c.principal_px.y}},
          {"radial", c.radial},
          {"tangential", {c.tangential.x, c.tangential.y}}};
}

CameraModel camera_from(JsonObject json) {
  CameraModel c;
  c.fisheye = json.one_of("model", {"pinhole", "fisheye"}) == "fisheye";
  c.size = {static_cast<int>(json.integer("width", 1, 65536)), static_cast<int>(json.integer("height", 1, 65536))};
  c.focal_px = json.number("focal_px", {1, 1e7});
  const auto pair = [&](const char* key) {
    const auto v = json.numbers(key);
    if (v.size() != 2) json.fail(key, fmt::format("{} numbers", v.size()), "2");
    return cv::Point2d(v[0], v[1]);
  };
  c.principal_px = pair("principal_px");
  c.radial = json.numbers("radial");
  c.tangential = pair("tangential");
  json.done();
  return c;
}

}  // namespace pecs::calibration
