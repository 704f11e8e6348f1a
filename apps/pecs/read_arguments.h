#pragma once
#include <CLI/CLI.hpp>

#include "pecs/events/format.h"

namespace pecs::app {

// --size and --time-unit: what an event file may not state.
void add_read_options(CLI::App& command, events::ReadOptions& read);
// --time-unit alone.
CLI::Option* add_time_unit(CLI::App& command, std::optional<TimeUnit>& unit, const char* help);

}  // namespace pecs::app
