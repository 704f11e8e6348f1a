#pragma once
// Estimates the parameters of a lab scene (axes: lab_scene.h) from a recording of it.
#include <variant>

#include "pecs/calibration/board.h"
#include "pecs/calibration/lab_scene.h"

namespace pecs::calibration {

// Position of the target at the middle of the recording, and its motion.
struct TargetEstimate {
  double time_us = 0;     // clock of the file
  cv::Vec3d rotation;     // rotation from the unrotated camera to the camera, angle-axis in OpenCV's camera axes [rad]
  cv::Vec3d position_mm;  // right, up, distance
  std::variant<BoardMotion, DiskMotion> motion;
  std::map<std::string, double> deviation;  // standard deviations, by the scene's parameters and turn_{x,y,z}_deg
  Json residual;
  std::vector<std::string> warnings;
  std::vector<BoardView> views;
};
struct Search {
  int views = 8;             // times at which a board is searched for
  bool hold_camera = false;  // keep the camera rotation of the scene
};
// Throws bad_input when the target is not found, or does not move as in the scene.
TargetEstimate find_in_recording(const events::Recording& recording, const LabScene& scene, const Optics& optics,
                                 const Search& search, const std::string& file);

enum class ClockModel { file, offset, offset_and_rate };  // parameters estimated instead of start and speed

struct Aligned {
  LabScene scene;                              // with the estimated values
  double clock_offset_us = 0, clock_rate = 1;  // scene time = rate (file time - offset)
  Json json;                                   // content of aligned.json
};
Aligned align_scene(const LabScene& scene, const TargetEstimate& real, ClockModel clock);
// The same, corrected by `sim`, the estimate from a simulation of `scene`: errors common to both (latency of the
// pixels, bias of the search) cancel.
Aligned align_scene(const LabScene& scene, const TargetEstimate& real, const TargetEstimate& sim, ClockModel clock);

// Recorded events at three times, with the target's outline for `before` (left) and `after` (right); with `sim`, its
// events instead of the outlines on the right.
cv::Mat overlay_picture(const events::Recording& real, const LabScene& before, const Aligned& after,
                        const Optics& optics, const events::Recording* sim);

}  // namespace pecs::calibration
