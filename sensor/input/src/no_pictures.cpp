// Replaces the other files in a build with PECS_CORE, which has no OpenCV; frames.cpp is in both.
#include "pecs/error.h"
#include "pecs/input/pictures.h"
#include "pecs/input/screen.h"

namespace pecs::input {

std::unique_ptr<sensor::FrameSource> open_pictures(const std::filesystem::path& path, const PictureOptions&) {
  throw not_in_core(path.string() + ": pictures and video");
}

sensor::SenseReport sense_on_screen(const Screen&, sensor::SenseOptions) { throw not_in_core("--view"); }

}  // namespace pecs::input
