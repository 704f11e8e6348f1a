#pragma once
// The text of the camera's shader.
#include <string>

#include "pecs/lens/osl_camera.h"

namespace pecs::lens {

// The film's own axes and its normal towards the scene, in the lens frame.
struct FilmAxes {
  Vec3 right, up, ahead;
};
FilmAxes film_axes(const CameraOptions& options);

// All of the camera but `osl` is made.
std::string shader_text(const Prescription& lens, const Camera& camera);

}  // namespace pecs::lens
