#pragma once
// --quiet and --verbose: one pair for the program, which every command takes and says in the same words.
#include <CLI/CLI.hpp>
#include <chrono>
#include <filesystem>
#include <string>

#include "pecs/run_record.h"

namespace pecs::app {

class Talk {
 public:
  // To `app` and every command below it; commands that are Python have their own (python/pecs/_arguments.py).
  void add_to(CLI::App& app);

  bool quiet() const { return quiet_; }
  bool verbose() const { return verbose_; }

  // Prints a warning on stderr, if not quiet.
  void warn(const std::string& line) const;

  // Writes the run record; verbose: and says on stderr what it holds.
  void record(const std::filesystem::path& output, const RunRecord& record);

  // The command below `app` is done. Verbose: says on stderr what it used, where no record said so, and how long it
  // took.
  void end(const CLI::App& app) const;

 private:
  bool quiet_ = false, verbose_ = false, recorded_ = false;
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

}  // namespace pecs::app
