#pragma once
// The parameters of a lab scene (lab_scene.h, which has the axes) under which it looks as a recording does.
#include <variant>

#include "pecs/calibration/board.h"
#include "pecs/calibration/lab_scene.h"

namespace pecs::calibration {

// Where the target is at the recording's middle, and how it moves.
struct TargetEstimate {
  double time_us = 0;  // clock of the file
  cv::Vec3d turn;      // camera from the unturned camera, angle-axis, camera axes as OpenCV's [rad]
  cv::Vec3d place_mm;  // right, up, distance
  std::variant<BoardMotion, DiskMotion> motion;
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
TargetEstimate find_in_recording(const events::Recording& recording, const LabScene& scene, const Optics& optics,
                                 const Search& search, const std::string& file);

enum class Clock { file, offset, offset_and_rate };  // what is found of it, instead of start and speed

struct Aligned {
  LabScene scene;                              // with the values found
  double clock_offset_us = 0, clock_rate = 1;  // scene time = rate (file time - offset)
  Json json;                                   // as aligned.json holds it
};
Aligned align_scene(const LabScene& scene, const TargetEstimate& real, Clock clock);
// The same, corrected by what the same search finds in `sim`, a simulation of `scene` as it is: what both have in
// common (latency of the pixels, errors of the search) cancels.
Aligned align_scene(const LabScene& scene, const TargetEstimate& real, const TargetEstimate& sim, Clock clock);

// Recorded events at three instants with the target's outline where `before` and `after` say it was (left, right); with
// `sim`, its events instead of outlines after the alignment.
cv::Mat overlay_picture(const events::Recording& real, const LabScene& before, const Aligned& after,
                        const Optics& optics, const events::Recording* sim);

}  // namespace pecs::calibration
