#pragma once
// Progress of long work on stderr: a bar with the time left on a terminal, a plain line every tenth otherwise.
#include <chrono>
#include <cstdint>
#include <string>

namespace pecs {

class Progress {
 public:
  // total = 0: unknown, only counts are shown. quiet: nothing is printed.
  Progress(std::string what, std::uint64_t total, bool quiet = false);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  void at(std::uint64_t done);

 private:
  using Clock = std::chrono::steady_clock;
  std::string what_;
  std::uint64_t total_, done_ = 0;
  int last_tenth_ = 0;
  bool terminal_, quiet_, drawn_ = false;
  Clock::time_point start_ = Clock::now(), last_draw_{};
};

}  // namespace pecs
