#pragma once
// Frames from folders of PNG, TIFF, JPEG, … pictures and from video, through OpenCV. Encoded pixels become scene-linear
// light: by sRGB's curve (integers) or as they are (floating point), or by OpenColorIO from a named space. Grey
// pictures are one band; colour is three, at 465, 550 and 610 nm. 1 is white.
#include <memory>

#include "pecs/sensor/source.h"

namespace pecs::input {

struct PictureOptions {
  sensor::FrameTimes times;                          // video: default the file's own rate
  std::optional<std::string> colour_space;           // "srgb", "linear", or one of the OpenColorIO config's
  std::optional<std::filesystem::path> ocio_config;  // else $OCIO
};

// A folder of pictures, or a video file. Throws not_found, bad_input, and usage for a wrong colour space.
std::unique_ptr<sensor::FrameSource> open_pictures(const std::filesystem::path& path, const PictureOptions& options);

// EXR stack, folder of EXR files, folder of pictures, or video: by what is there.
std::unique_ptr<sensor::FrameSource> open_frames(const std::filesystem::path& path, const PictureOptions& options);

}  // namespace pecs::input
