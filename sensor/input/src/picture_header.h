#pragma once
// Fields of a picture's header that OpenCV does not read: PNG, TIFF, JPEG (JFIF and Exif), BMP, WebP.
#include <filesystem>

namespace pecs::input {

struct PictureHeader {
  double pixel_aspect = 1;  // width of a pixel over its height
  bool alpha = false;       // a channel of opacity
};
PictureHeader picture_header(const std::filesystem::path& path);

}  // namespace pecs::input
