#pragma once
// A lab scene (scenes/board, scenes/rotating_disk): the values of its scene.json, as changed by an aligned.json
// (docs/reference/aligned_scene.md).
//
// World of the scenes: x right, y away from the camera, z up; the camera's entrance pupil is the origin. Blender's
// camera looks along its -z with +y up: rotation_deg is its XYZ Euler rotation, (90, 0, 0) looks along +y. Targets face
// -y; the board slides along x.
#include <map>

#include "pecs/calibration/optics.h"

namespace pecs::calibration {

// Position over time at a constant speed; the unit distinguishes the targets.
template <class Unit>
struct UniformMotion {
  double at = 0, per_s = 0;
  UniformMotion later(double seconds) const { return {at + per_s * seconds, per_s}; }
};
struct Millimetres {};
struct Degrees {};
using BoardMotion = UniformMotion<Millimetres>;  // of its centre, to the right
using DiskMotion = UniformMotion<Degrees>;       // of a white sector's leading edge, counter-clockwise on screen

struct LabScene {
  std::string name, file;                // name of the folder; path of scene.json
  std::map<std::string, double> values;  // its numbers
  Json light = Json::object();           // its illuminance and spectrum, which no recording shows
  std::map<std::string, Range> ranges;
  LensSetting lens;
  cv::Vec3d rotation_deg{90, 0, 0};

  bool is_board() const { return values.contains("board_distance_mm"); }
  cv::Vec3d position_mm() const;   // right (of a board: at scene time 0), up, distance
  BoardMotion board() const;       // at scene time 0
  DiskMotion disk() const;         // at scene time 0
  double disk_period_deg() const;  // from a white sector to the next
  // Sets values; throws bad_input for one outside its declared range.
  void set(const std::map<std::string, double>& found);
};
// `folder` contains scene.json. Throws unsupported for a scene that is neither board nor disk.
LabScene load_lab_scene(const std::string& folder);
// Sets the values of an aligned.json.
void apply_aligned(LabScene& scene, const std::string& aligned_file);

}  // namespace pecs::calibration
