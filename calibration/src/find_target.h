#pragma once
// find_in_recording for each kind of target.
#include "pecs/calibration/align.h"

namespace pecs::calibration {

TargetEstimate find_sliding_board(const events::Recording& recording, const LabScene& scene, const Optics& optics,
                                  const Search& how, const std::string& file);
TargetEstimate find_turning_disk(const events::Recording& recording, const LabScene& scene, const Optics& optics,
                                 const Search& how, const std::string& file);

}  // namespace pecs::calibration
