#include "pecs/error.h"
#include "pecs/input/pictures.h"
#include "pecs/sensor/stack.h"

namespace pecs::input {
namespace fs = std::filesystem;

std::unique_ptr<sensor::FrameSource> open_frames(const fs::path& path, const PictureOptions& options) {
  if (!fs::exists(path)) throw not_found(path.string(), "no such file or folder");
  static const std::string kExr[] = {".exr"};
  if (fs::is_directory(path) && (fs::exists(path / "stack.json") || !sensor::files_in_order(path, kExr).empty())) {
    const auto refuse = [&](const char* option) { throw bad_usage(option, path.string(), "pictures or a video"); };
    if (options.colour_space) refuse("--colorspace");
    if (options.ocio_config) refuse("--ocio");
    if (!options.flow) refuse("--no-flow");
    if (options.rolling_shutter_us) refuse("--rolling-shutter");
    if (options.crop) refuse("--crop");
    if (options.size) refuse("--size");
    return std::make_unique<sensor::StackReader>(path, options.times);
  }
  return open_pictures(path, options);
}

}  // namespace pecs::input
