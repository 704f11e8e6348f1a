#include "pecs/progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>

namespace pecs {

Progress::Progress(std::string what, std::uint64_t total, bool quiet)
    : what_(std::move(what)), total_(total), terminal_(isatty(STDERR_FILENO) != 0), quiet_(quiet) {}

Progress::~Progress() {
  if (terminal_ && drawn_) std::fputc('\n', stderr);
}

void Progress::at(std::uint64_t done) {
  done_ = done;
  if (quiet_) return;
  const Clock::time_point now = Clock::now();
  const double elapsed_s = std::chrono::duration<double>(now - start_).count();
  const double fraction = total_ ? static_cast<double>(done_) / static_cast<double>(total_) : 0.0;
  const double left_s = fraction > 0 ? elapsed_s * (1 - fraction) / fraction : 0.0;
  if (terminal_) {
    if (now - last_draw_ < std::chrono::milliseconds(100) && done_ != total_) return;
    last_draw_ = now;
    drawn_ = true;
    const int filled = static_cast<int>(fraction * 30);
    if (total_)
      fmt::print(stderr, "\r{} [{:#<{}}{:.<{}}] {}/{} {:.0f} s left \033[K", what_, "", filled, "", 30 - filled, done_,
                 total_, left_s);
    else
      fmt::print(stderr, "\r{} {}\033[K", what_, done_);
    std::fflush(stderr);
  } else if (total_) {
    const int tenth = static_cast<int>(fraction * 10);
    if (tenth <= last_tenth_) return;
    last_tenth_ = tenth;
    fmt::print(stderr, "{}: {}/{}, {:.0f} s left\n", what_, done_, total_, left_s);
  }
}

}  // namespace pecs
