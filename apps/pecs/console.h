#pragma once
// --quiet and --verbose of all commands.
#include <CLI/CLI.hpp>
#include <chrono>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "pecs/run_record.h"

namespace pecs::app {

class Console {
 public:
  // arguments: the command line, for run records.
  explicit Console(std::vector<std::string> arguments) : arguments_(std::move(arguments)) {}

  // Adds the options to `app` and every command below it; commands in Python have their own
  // (python/pecs/_arguments.py).
  void add_to(CLI::App& app);

  const std::vector<std::string>& arguments() const { return arguments_; }
  bool quiet() const { return quiet_; }
  bool verbose() const { return verbose_; }

  // Prints a warning on stderr, unless quiet.
  void warn(const std::string& line) const;

  // Writes the run record; with --verbose also prints its configuration and inputs on stderr.
  void record(const std::filesystem::path& output, RunRecord record);

  // Call after the command. With --verbose prints the options, unless record() did, and the duration on stderr.
  void end(const CLI::App& app) const;

 private:
  std::vector<std::string> arguments_;
  bool quiet_ = false, verbose_ = false, recorded_ = false;
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

}  // namespace pecs::app
