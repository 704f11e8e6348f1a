// What a build without librsvg has in place of drawing.cpp.
#include "drawing.h"
#include "pecs/error.h"

namespace pecs::app {
namespace {

[[noreturn]] void refuse() {
  throw Error(ExitCode::usage,
              "-o: this build writes drawings as .svg only (it lacks librsvg); a browser shows and prints them");
}

}  // namespace

std::string drawn_as_pdf(const std::string&) { refuse(); }
std::string drawn_as_png(const std::string&, int) { refuse(); }

}  // namespace pecs::app
