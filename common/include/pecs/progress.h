#pragma once
// Progress on stderr: on a terminal a bar with the remaining time, otherwise a line for each tenth. With
// PECS_PROGRESS=json in the environment, JSON lines for the calling program (docs/reference/exit_codes.md).
#include <chrono>
#include <cstdint>
#include <string>

namespace pecs {

class Progress {
 public:
  // total = 0: unknown, only counts are printed. quiet: nothing is printed.
  Progress(std::string task, std::uint64_t total, bool quiet = false);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  void at(std::uint64_t done);

 private:
  using Clock = std::chrono::steady_clock;
  void print_json(double left_s) const;

  std::string task_;
  std::uint64_t total_, done_ = 0;
  int last_tenth_ = 0;
  bool json_, terminal_, quiet_, drawn_ = false;
  Clock::time_point start_ = Clock::now(), last_draw_{};
};

}  // namespace pecs
