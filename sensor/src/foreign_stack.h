#pragma once
// EXR sequences of other programs.
#include <filesystem>
#include <string>

#include "pecs/sensor/source.h"

namespace pecs::sensor {

struct ForeignStack {
  StackInfo info;      // without times
  std::string layout;  // its name
};

// What a file of another program holds, by its channels' names.
ForeignStack foreign_stack(const std::filesystem::path& path);

}  // namespace pecs::sensor
