#include "picture_file.h"

#include <fmt/format.h>

#include <opencv2/core/mat.hpp>
#include <span>

#include "drawing.h"
#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/input/media.h"

namespace pecs::app {

void write_png(const std::string& path, const cv::Mat& picture) {
  const std::vector<std::uint8_t> png = input::media().png_of(picture);
  write_file(path, std::as_bytes(std::span(png)));
}

void write_picture(const std::string& path, const std::string& svg, int width_px) {
  const bool png = path.ends_with(".png"), pdf = path.ends_with(".pdf");
  if (!png && !pdf && !path.ends_with(".svg"))
    throw Error(ExitCode::usage, fmt::format("-o: got '{}', wanted a name that ends in .svg, .png or .pdf", path));
  write_file(path, png ? drawn_as_png(svg, width_px) : pdf ? drawn_as_pdf(svg) : svg);
}

}  // namespace pecs::app
