#pragma once
// The text of the camera's shader.
#include <string>

#include "pecs/lens/osl_camera.h"

namespace pecs::lens {

// All of the camera but `osl` is made.
std::string shader_text(const Prescription& lens, const Camera& camera);

}  // namespace pecs::lens
