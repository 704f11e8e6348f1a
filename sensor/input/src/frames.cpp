#include <fmt/format.h>

#include "pecs/error.h"
#include "pecs/input/pictures.h"
#include "pecs/sensor/stack.h"

namespace pecs::input {
namespace fs = std::filesystem;

std::unique_ptr<sensor::FrameSource> open_frames(const fs::path& path, const PictureOptions& options) {
  if (!fs::exists(path)) throw not_found(path.string(), "no such file or folder");
  static const std::string kExr[] = {".exr"};
  const auto refuse = [&](const char* option, const char* wanted) {
    throw Error(ExitCode::usage, fmt::format("{}: got {}, wanted {}", option, path.string(), wanted));
  };
  if (fs::is_directory(path) && (fs::exists(path / "stack.json") || !sensor::files_in_order(path, kExr).empty())) {
    if (options.colour_space) refuse("--colorspace", "pictures or a video");
    if (options.ocio_config) refuse("--ocio", "pictures or a video");
    if (!options.flow) refuse("--no-flow", "pictures or a video");
    if (options.rolling_shutter_us) refuse("--rolling-shutter", "pictures or a video");
    if (options.crop) refuse("--crop", "pictures or a video");
    if (options.size) refuse("--size", "pictures or a video");
    return std::make_unique<sensor::StackReader>(path, options.times);
  }
  return open_pictures(path, options);
}

}  // namespace pecs::input
