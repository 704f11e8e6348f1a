#pragma once
#include <string>

namespace cv {
class Mat;
}

namespace pecs::app {

void write_png(const std::string& path, const cv::Mat& picture);

// Writes an SVG drawing: as it is to a name that ends in .svg, drawn (librsvg) width_px wide to one in .png, in its own
// size to one in .pdf (width and height in mm). Throws Error for other endings.
void write_picture(const std::string& path, const std::string& svg, int width_px);

}  // namespace pecs::app
