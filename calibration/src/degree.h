#pragma once
#include <numbers>

namespace pecs::calibration {

inline constexpr double kDegree = std::numbers::pi / 180;

}  // namespace pecs::calibration
