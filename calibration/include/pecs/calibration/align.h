#pragma once
// The parameters of a lab scene (scenes/board, scenes/rotating_disk) under which it looks as a recording does.
//
// World of the scenes: x right, y away from the camera, z up; the camera's entrance pupil is the origin. Blender's
// camera looks along its -z with +y up: rotation_deg is its XYZ Euler rotation, (90, 0, 0) looks along +y. Targets face
// -y; the board slides along x.
#include <map>

#include "pecs/calibration/board.h"
#include "pecs/calibration/disk.h"
#include "pecs/calibration/optics.h"

namespace pecs::calibration {

struct LabScene {
  std::string name, file;                // of the folder; scene.json
  std::map<std::string, double> values;  // its numbers
  std::map<std::string, Range> ranges;
  LensSetting lens;
  cv::Vec3d rotation_deg{90, 0, 0};
  bool is_board() const { return values.contains("board_distance_mm"); }
};
// `folder`: holds scene.json. Throws unsupported for a scene that is neither board nor disk.
LabScene load_lab_scene(const std::string& folder);
// Puts the values of an aligned.json in their place.
void apply_aligned(LabScene& scene, const std::string& aligned_file);

// The scene's own unknowns, at the recording's middle. Board: along = to the right [mm], rate in mm/s (negative: to
// the left). Disk: along = angle of a white sector's leading edge [deg], rate in deg/s.
struct Found {
  double time_us = 0;  // clock of the file
  cv::Vec3d turn;      // camera from the unturned camera, angle-axis, camera axes as OpenCV's [rad]
  double right_mm = 0, up_mm = 0, distance_mm = 0;  // of the board (right: = along) or the disk
  double along = 0, rate = 0;
  std::map<std::string, double> deviation;  // standard, by the names of the scene's parameters and turn_{x,y,z}_deg
  Json residual;
  std::vector<std::string> warnings;
  std::vector<BoardView> views;
};
struct Search {
  int views = 8;             // instants at which a board is looked for
  bool hold_camera = false;  // the camera is turned as the scene says
};
// Throws bad_input when the target is not found, or does not move as the scene says.
Found find_in_recording(const events::Recording& recording, const LabScene& scene, const Optics& optics,
                        const Search& search, const std::string& file);

enum class Clock { file, offset, offset_and_rate };  // what is found of it, instead of start and speed

struct Aligned {
  LabScene scene;                              // with the values found
  double clock_offset_us = 0, clock_rate = 1;  // scene time = rate (file time - offset)
  Json json;                                   // as aligned.json holds it
};
Aligned align_scene(const LabScene& scene, const Found& real, Clock clock);
// The same, corrected by what the same search finds in `sim`, a simulation of `scene` as it is: what both have in
// common (latency of the pixels, errors of the search) cancels.
Aligned align_scene(const LabScene& scene, const Found& real, const Found& sim, Clock clock);

// Recorded events at four instants with the target's outline where `before` and `after` say it was (left, right); with
// `sim`, its events instead of outlines after the alignment.
cv::Mat overlay_picture(const events::Recording& real, const LabScene& before, const Aligned& after,
                        const Optics& optics, const events::Recording* sim);

}  // namespace pecs::calibration
