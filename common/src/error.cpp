#include "pecs/error.h"

#include <fmt/format.h>

namespace pecs {

Error bad_input(const std::string& file, const std::string& place, const std::string& got, const std::string& wanted) {
  return {ExitCode::bad_input, place.empty() ? fmt::format("{}: got {}, wanted {}", file, got, wanted)
                                             : fmt::format("{}: {}: got {}, wanted {}", file, place, got, wanted)};
}

Error not_found(const std::string& file, const std::string& reason) {
  return {ExitCode::not_found, fmt::format("{}: cannot be opened: {}", file, reason)};
}

Error bad_output(const std::string& file, const std::string& reason) {
  return {ExitCode::bad_output, fmt::format("{}: cannot be written: {}", file, reason)};
}

}  // namespace pecs
