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

// A difference of positions; a disk looks the same after a period.
double difference(const LabScene&, Millimetres, double mm) { return mm; }
double difference(const LabScene& s, Degrees, double deg) { return std::remainder(deg, s.disk_period_deg()); }

using Values = std::map<std::string, double>;
Values values_of(const LabScene&, const BoardMotion& at_zero, const cv::Vec3d& place_mm) {
  return {{"start_right_mm", at_zero.at},
          {"board_up_mm", place_mm[1]},
          {"board_distance_mm", place_mm[2]},
          {"speed_m_per_s", -at_zero.per_s / 1000}};
}
Values values_of(const LabScene& s, const DiskMotion& at_zero, const cv::Vec3d& place_mm) {
  const double period = s.disk_period_deg();
  return {{"phase_deg", at_zero.at - period * std::floor(at_zero.at / period)},
          {"disk_right_mm", place_mm[0]},
          {"disk_up_mm", place_mm[1]},
          {"disk_distance_mm", place_mm[2]},
          {"rpm", at_zero.per_s / 6}};
}

// Another distance than the scene's: most likely the target is not as large as the scene says.
void check_size(const LabScene& scene, double distance_mm, std::vector<std::string>& warnings) {
  const double own_mm = scene.place_mm()[2], ratio = distance_mm / own_mm;
  const char* size = scene.is_board() ? "square_mm" : "disk_radius_mm";
  if (std::abs(ratio - 1) > 0.05)
    warnings.push_back(
        fmt::format("the target is {:.0f} mm away, the scene says {:.0f}: a wrong {} ({:.2f} mm would agree)?",
                    distance_mm, own_mm, size, scene.values.at(size) / ratio));
}

// `at_zero`: the motion found, at time 0 of the file's clock.
template <class Unit>
Aligned finished(const LabScene& scene, const TargetEstimate& real, const cv::Vec3d& turn, const cv::Vec3d& place_mm,
                 UniformMotion<Unit> at_zero, Clock clock, const char* how) {
  Aligned out;
  if (clock != Clock::file) {
    // found(file time) = the scene's own(rate (file time - offset))
    const UniformMotion<Unit> own = own_motion(scene, Unit{});
    const double per_s = clock == Clock::offset_and_rate ? own.per_s : at_zero.per_s;
    if (per_s == 0 || at_zero.per_s == 0)
      throw bad_input(scene.file, "speed", "0", "a target that moves, to find the clock");
    out.clock_offset_us = difference(scene, Unit{}, own.at - at_zero.at) / at_zero.per_s * 1e6;
    out.clock_rate = at_zero.per_s / per_s;
    at_zero = {own.at, per_s};
  }
  const Values found = values_of(scene, at_zero, place_mm);
  out.scene = scene;
  out.scene.rotation_deg = blender_rotation_deg(turn);
  out.scene.set(found);
  std::vector<std::string> warnings = real.warnings;
  check_size(scene, place_mm[2], warnings);
  const cv::Vec3d r = out.scene.rotation_deg;
  out.json = {{"pecs_aligned", 1},
              {"scene", scene.name},
              {"camera", {{"rotation_deg", {r[0], r[1], r[2]}}}},
              {"parameters", found},
              {"clock", {{"offset_us", out.clock_offset_us}, {"rate", out.clock_rate}}},
              {"deviation", real.deviation},
              {"residual", real.residual},
              {"how", how},
              {"warnings", warnings}};
  return out;
}

// The middle of a target as a direction: x / z and y / z of the camera.
cv::Vec3d seen_at(const cv::Matx33d& turn, const cv::Vec3d& place_mm) {
  const cv::Vec3d p = turn * cv::Vec3d(place_mm[0], -place_mm[1], place_mm[2]);
  return p / p[2];
}

// The simulation's own error of the position, at the recording's middle.
double error_of(const BoardMotion& real, const BoardMotion&, const LabScene&, const cv::Vec3d& place_mm, double,
                double) {
  return real.at - place_mm[0];
}
double error_of(const DiskMotion&, const DiskMotion& sim, const LabScene& scene, const cv::Vec3d&, double t_s,
                double sim_s) {
  return difference(scene, Degrees{}, sim.later(t_s - sim_s).at - scene.disk().later(t_s).at);
}

template <class Unit>
Aligned corrected(const LabScene& scene, const TargetEstimate& real, const TargetEstimate& sim, Clock clock) {
  const auto& real_motion = std::get<UniformMotion<Unit>>(real.motion);
  const auto& sim_motion = std::get<UniformMotion<Unit>>(sim.motion);
  const UniformMotion<Unit> own = own_motion(scene, Unit{});
  const double t_s = real.time_us * 1e-6, sim_s = sim.time_us * 1e-6;
  const cv::Matx33d own_turn = matrix_of(turn_from_blender(scene.rotation_deg));
  const cv::Matx33d turn = matrix_of(real.turn) * matrix_of(sim.turn).t() * own_turn;

  // The middle of the target is corrected where it is seen: turn and place exchange, each alone is known far worse.
  cv::Vec3d own_place = scene.place_mm();
  if constexpr (std::is_same_v<Unit, Millimetres>) own_place[0] = own.later(sim_s).at;
  const double distance = real.place_mm[2] - sim.place_mm[2] + own_place[2];
  const cv::Vec3d at = turn.t() * (seen_at(matrix_of(real.turn), real.place_mm) -
                                   seen_at(matrix_of(sim.turn), sim.place_mm) + seen_at(own_turn, own_place));
  const cv::Vec3d place = cv::Vec3d(at[0], -at[1], at[2]) * (distance / at[2]);

  const double error = error_of(real_motion, sim_motion, scene, place, t_s, sim_s);
  const double per_s = real_motion.per_s * (own.per_s != 0 ? own.per_s / sim_motion.per_s : 1);
  const UniformMotion<Unit> found{real_motion.at - error, per_s};
  return finished(scene, real, turn_of(turn), place, found.later(-t_s), clock,
                  "measured, less what the same search finds wrong in the simulation");
}

}  // namespace

TargetEstimate find_in_recording(const events::Recording& recording, const LabScene& scene, const Optics& optics,
                                 const Search& search, const std::string& file) {
  return scene.is_board() ? find_sliding_board(recording, scene, optics, search, file)
                          : find_turning_disk(recording, scene, optics, search, file);
}

Aligned align_scene(const LabScene& scene, const TargetEstimate& real, Clock clock) {
  return std::visit(
      [&](const auto& motion) {
        return finished(scene, real, real.turn, real.place_mm, motion.later(-real.time_us * 1e-6), clock, "measured");
      },
      real.motion);
}

Aligned align_scene(const LabScene& scene, const TargetEstimate& real, const TargetEstimate& sim, Clock clock) {
  return scene.is_board() ? corrected<Millimetres>(scene, real, sim, clock)
                          : corrected<Degrees>(scene, real, sim, clock);
}

}  // namespace pecs::calibration
