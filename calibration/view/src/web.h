#pragma once
// The pages of calibration/view/web/, compiled in.
#include <string_view>

namespace pecs::view::web {

extern const std::string_view kEvents3d, kReport;

}  // namespace pecs::view::web
