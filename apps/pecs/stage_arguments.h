#pragma once
// Options of the chip's digital stages, which `pecs sense` and `pecs convert` share.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <optional>

#include "pecs/sensor/stages.h"

namespace pecs::app {

void add_stages(CLI::App& command, sensor::StageOptions& stages, std::optional<std::filesystem::path>& dropped);

}  // namespace pecs::app
