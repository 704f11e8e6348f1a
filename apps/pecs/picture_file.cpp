#include "picture_file.h"

#include <fmt/format.h>

#include "drawing.h"
#include "pecs/error.h"
#include "pecs/files.h"

namespace pecs::app {

void write_picture(const std::string& path, const std::string& svg, int width_px) {
  const bool png = path.ends_with(".png"), pdf = path.ends_with(".pdf");
  if (!png && !pdf && !path.ends_with(".svg"))
    throw Error(ExitCode::usage, fmt::format("-o: got '{}', wanted a name that ends in .svg, .png or .pdf", path));
  write_file(path, png ? drawn_as_png(svg, width_px) : pdf ? drawn_as_pdf(svg) : svg);
}

}  // namespace pecs::app
