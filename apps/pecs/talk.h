#pragma once
// --quiet and --verbose.
#include <CLI/CLI.hpp>
#include <chrono>
#include <filesystem>

#include "pecs/run_record.h"

namespace pecs::app {

struct Talk {
  bool quiet = false, verbose = false;
  std::chrono::steady_clock::time_point begin = std::chrono::steady_clock::now();

  void add_verbose_to(CLI::App& command);
  void add_to(CLI::App& command);  // both; for what shows its progress

  // Writes the run record; verbose: also says on stderr what was used and how long it took.
  void record(const std::filesystem::path& output, const RunRecord& record) const;
};

}  // namespace pecs::app
