#include "pecs/calibration/align.h"

#include <fmt/format.h>

#include <cmath>

#include "camera_axes.h"
#include "find_target.h"
#include "pecs/error.h"

namespace pecs::calibration {
namespace {

BoardMotion own_motion(const LabScene& s, Millimetres) { return s.board(); }
DiskMotion own_motion(const LabScene& s, Degrees) { return s.disk(); }

// Difference of two positions; for a disk, modulo the period after which it looks the same.
double difference(const LabScene&, Millimetres, double mm) { return mm; }
double difference(const LabScene& s, Degrees, double deg) { return std::remainder(deg, s.disk_period_deg()); }

using Values = std::map<std::string, double>;
Values values_of(const LabScene&, const BoardMotion& at_zero, const cv::Vec3d& position_mm) {
  return {{"start_right_mm", at_zero.at},
          {"board_up_mm", position_mm[1]},
          {"board_distance_mm", position_mm[2]},
          {"speed_m_per_s", -at_zero.per_s / 1000}};
}
Values values_of(const LabScene& s, const DiskMotion& at_zero, const cv::Vec3d& position_mm) {
  const double period = s.disk_period_deg();
  return {{"phase_deg", at_zero.at - period * std::floor(at_zero.at / period)},
          {"disk_right_mm", position_mm[0]},
          {"disk_up_mm", position_mm[1]},
          {"disk_distance_mm", position_mm[2]},
          {"rpm", at_zero.per_s / 6}};
}

// Warns of a distance that differs from the scene's: the target's size in the scene is then probably wrong.
void check_size(const LabScene& scene, double distance_mm, std::vector<std::string>& warnings) {
  const double own_mm = scene.position_mm()[2], ratio = distance_mm / own_mm;
  const char* size = scene.is_board() ? "square_mm" : "disk_radius_mm";
  if (std::abs(ratio - 1) > 0.05)
    warnings.push_back(
        fmt::format("the target is {:.0f} mm away, but {:.0f} mm in the scene; check {} ({:.2f} mm would agree)",
                    distance_mm, own_mm, size, scene.values.at(size) / ratio));
}

// `at_zero`: the estimated motion at time 0 of the file's clock.
template <class Unit>
Aligned finished(const LabScene& scene, const TargetEstimate& real, const cv::Vec3d& rotation,
                 const cv::Vec3d& position_mm, UniformMotion<Unit> at_zero, ClockModel clock, const char* how) {
  Aligned out;
  if (clock != ClockModel::file) {
    // estimated motion(file time) = scene's motion(rate (file time - offset))
    const UniformMotion<Unit> own = own_motion(scene, Unit{});
    const double per_s = clock == ClockModel::offset_and_rate ? own.per_s : at_zero.per_s;
    if (per_s == 0 || at_zero.per_s == 0)
      throw bad_input(scene.file, "speed", "0", "a moving target, which --clock requires");
    out.clock_offset_us = difference(scene, Unit{}, own.at - at_zero.at) / at_zero.per_s * 1e6;
    out.clock_rate = at_zero.per_s / per_s;
    at_zero = {own.at, per_s};
  }
  const Values found = values_of(scene, at_zero, position_mm);
  out.scene = scene;
  out.scene.rotation_deg = blender_rotation_deg(rotation);
  out.scene.set(found);
  std::vector<std::string> warnings = real.warnings;
  check_size(scene, position_mm[2], warnings);
  const cv::Vec3d r = out.scene.rotation_deg;
  out.json = {{"pecs_aligned", 1},
              {"scene", scene.name},
              {"camera", {{"rotation_deg", {r[0], r[1], r[2]}}}},
              {"parameters", found},
              {"not_estimated", scene.light},
              {"clock", {{"offset_us", out.clock_offset_us}, {"rate", out.clock_rate}}},
              {"deviation", real.deviation},
              {"residual", real.residual},
              {"how", how},
              {"warnings", warnings}};
  return out;
}

// Direction of the target's centre: x / z and y / z in camera axes.
cv::Vec3d direction_of(const cv::Matx33d& rotation, const cv::Vec3d& position_mm) {
  const cv::Vec3d p = rotation * cv::Vec3d(position_mm[0], -position_mm[1], position_mm[2]);
  return p / p[2];
}

// Error of the position estimated from the simulation, at the middle of the recording.
double error_of(const BoardMotion& real, const BoardMotion&, const LabScene&, const cv::Vec3d& position_mm, double,
                double) {
  return real.at - position_mm[0];
}
double error_of(const DiskMotion&, const DiskMotion& sim, const LabScene& scene, const cv::Vec3d&, double t_s,
                double sim_s) {
  return difference(scene, Degrees{}, sim.later(t_s - sim_s).at - scene.disk().later(t_s).at);
}

template <class Unit>
Aligned corrected(const LabScene& scene, const TargetEstimate& real, const TargetEstimate& sim, ClockModel clock) {
  const auto& real_motion = std::get<UniformMotion<Unit>>(real.motion);
  const auto& sim_motion = std::get<UniformMotion<Unit>>(sim.motion);
  const UniformMotion<Unit> own = own_motion(scene, Unit{});
  const double t_s = real.time_us * 1e-6, sim_s = sim.time_us * 1e-6;
  const cv::Matx33d own_rotation = matrix_of(rotation_from_blender(scene.rotation_deg));
  const cv::Matx33d rotation = matrix_of(real.rotation) * matrix_of(sim.rotation).t() * own_rotation;

  // Corrects the direction of the target's centre: rotation and position compensate each other, and each alone is far
  // less certain.
  cv::Vec3d own_position = scene.position_mm();
  if constexpr (std::is_same_v<Unit, Millimetres>) own_position[0] = own.later(sim_s).at;
  const double distance = real.position_mm[2] - sim.position_mm[2] + own_position[2];
  const cv::Vec3d at = rotation.t() * (direction_of(matrix_of(real.rotation), real.position_mm) -
                                       direction_of(matrix_of(sim.rotation), sim.position_mm) +
                                       direction_of(own_rotation, own_position));
  const cv::Vec3d position = cv::Vec3d(at[0], -at[1], at[2]) * (distance / at[2]);

  const double error = error_of(real_motion, sim_motion, scene, position, t_s, sim_s);
  const double per_s = real_motion.per_s * (own.per_s != 0 ? own.per_s / sim_motion.per_s : 1);
  const UniformMotion<Unit> found{real_motion.at - error, per_s};
  return finished(scene, real, rotation_of(rotation), position, found.later(-t_s), clock,
                  "measured, minus the error of the same search in the simulation");
}

}  // namespace

TargetEstimate find_in_recording(const events::Recording& recording, const LabScene& scene, const Optics& optics,
                                 const Search& search, const std::string& file) {
  return scene.is_board() ? find_sliding_board(recording, scene, optics, search, file)
                          : find_turning_disk(recording, scene, optics, search, file);
}

Aligned align_scene(const LabScene& scene, const TargetEstimate& real, ClockModel clock) {
  return std::visit(
      [&](const auto& motion) {
        return finished(scene, real, real.rotation, real.position_mm, motion.later(-real.time_us * 1e-6), clock,
                        "measured");
      },
      real.motion);
}

Aligned align_scene(const LabScene& scene, const TargetEstimate& real, const TargetEstimate& sim, ClockModel clock) {
  return scene.is_board() ? corrected<Millimetres>(scene, real, sim, clock)
                          : corrected<Degrees>(scene, real, sim, clock);
}

}  // namespace pecs::calibration
