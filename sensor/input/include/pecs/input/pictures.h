#pragma once
// Frames from folders of PNG, TIFF, JPEG, … pictures and from video, through OpenCV. Encoded pixels become scene-linear
// light: by sRGB's curve (integers) or as they are (floating point), or by OpenColorIO from a named space. Grey
// pictures are one band; colour is three, at 465, 550 and 610 nm. 1 is white.
#include <memory>

#include "pecs/sensor/source.h"
#include "pecs/sensor/stages.h"

namespace pecs::input {

struct PictureOptions {
  sensor::FrameTimes times;                          // video: the file's rate, or its frames' times, by default
  std::optional<std::string> colour_space;           // "srgb", "linear", "gamma:G", or one of the OpenColorIO config
  std::optional<std::filesystem::path> ocio_config;  // otherwise $OCIO
  std::optional<sensor::RoiWindow> crop;             // of the pictures; resampled to `size`, in linear light
  std::optional<std::pair<int, int>> size;           // width and height
  // From the first row of the file's frames to the last: the rows' light is warped to one time (rolling_shutter.h).
  std::optional<double> rolling_shutter_us;
  bool flow = true;  // with motion from one to the next (motion_estimate.h)
};

// A folder of pictures, or a video file. Throws not_found, bad_input, and usage for a wrong colour space, or a rolling
// shutter longer than an interval between frames; in the core (PECS_CORE) unsupported.
std::unique_ptr<sensor::FrameSource> open_pictures(const std::filesystem::path& path, const PictureOptions& options);

// Opens an EXR stack, a folder of EXR files, a folder of pictures, or a video, by content.
std::unique_ptr<sensor::FrameSource> open_frames(const std::filesystem::path& path, const PictureOptions& options);

}  // namespace pecs::input
