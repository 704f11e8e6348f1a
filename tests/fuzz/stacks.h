#pragma once
// The stack of which seeds are made and into which frames are put.
#include "pecs/sensor/stack.h"

namespace pecs::fuzz {

inline Json stack_json() {
  return {{"pecs_stack", 1},
          {"quantity", "irradiance"},
          {"width", 5},
          {"height", 3},
          {"pixel_pitch_m", 4.86e-6},
          {"bands", {{{"lambda_nm", 480.5}, {"weight_nm", 80}}, {{"lambda_nm", 620}, {"weight_nm", 70}}}},
          {"times_ns", {0, 1000000}},
          {"period_ns", 2000000},
          {"lens", {{"name", "pecs_lab_15mm"}}},
          {"scene", {{"name", "room"}}},
          {"render", {{"samples", 4}}},
          {"versions", {{"pecs", "0"}}}};
}

inline void write_stack(const std::string& folder) {
  const sensor::StackWriter writer(folder, stack_json());
  std::vector<float> values(30);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = 0.25f * static_cast<float>(i);
  for (std::int64_t i = 0; i < 2; ++i) writer.write_frame(i, values);
}

}  // namespace pecs::fuzz
