#pragma once
// Fields of a picture's header that OpenCV does not read: PNG, TIFF, JPEG (JFIF and Exif), BMP, WebP, PGM and PPM.
#include <filesystem>

namespace pecs::input {

struct PictureHeader {
  double pixel_aspect = 1;  // width of a pixel over its height
  bool alpha = false;       // a channel of opacity
  bool pages = false;       // more than one picture of this size
  bool white_is_zero = false;
  bool turned = false;           // by Exif in WebP
  double gamma = 0;              // exponent from value to light, also of an ICC profile; 0: not stated
  bool other_primaries = false;  // than sRGB's
  int transfer = 2;              // transfer curve of ITU-T H.273, which overrides gamma; 2: not stated
  int white = 0;                 // greatest value; 0: that of the value's type
};
PictureHeader picture_header(const std::filesystem::path& path);

}  // namespace pecs::input
