#pragma once
// The pages of web/, embedded.
#include <string_view>

namespace pecs::view::web {

extern const std::string_view kEvents3d, kReport;

}  // namespace pecs::view::web
