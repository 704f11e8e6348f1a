#pragma once
// The pages of calibration/web/, compiled in.
#include <string_view>

namespace pecs::calibration::web {

extern const std::string_view kEvents3d, kReport;

}  // namespace pecs::calibration::web
