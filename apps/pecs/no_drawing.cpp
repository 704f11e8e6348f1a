// Replaces drawing.cpp in a build without librsvg.
#include "drawing.h"
#include "pecs/error.h"

namespace pecs::app {
namespace {

[[noreturn]] void refuse() {
  throw Error(ExitCode::usage,
              "-o: this build has no librsvg and writes drawings as .svg only; a browser displays and prints them");
}

}  // namespace

std::string drawn_as_pdf(const std::string&) { refuse(); }
std::string drawn_as_png(const std::string&, int) { refuse(); }

}  // namespace pecs::app
