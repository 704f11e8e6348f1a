#pragma once
// Linear light to what a screen shows: sRGB's curve, or a display and view of an OpenColorIO config.
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>

namespace pecs::input {

struct DisplayOptions {
  std::optional<std::filesystem::path> ocio_config;  // else $OCIO
  std::optional<std::string> display, view;          // else the config's default
};

// Encodes pixels in place: interleaved R, G, B, linear Rec. 709 (D65) in, display values out, 1 = full. Nothing in the
// options: IEC 61966-2-1. A config takes the pixels through its role cie_xyz_d65_interchange; without that role its
// scene_linear is taken to be linear Rec. 709. Throws usage, naming what the config has.
std::function<void(std::span<float>)> display_encoder(const DisplayOptions& options);

}  // namespace pecs::input
