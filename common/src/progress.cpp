#include "pecs/progress.h"

#include <fmt/format.h>

#include <cstdio>

#include "pecs/platform.h"

namespace pecs {
namespace {

bool wants_json() { return platform::environment("PECS_PROGRESS") == "json"; }

}  // namespace

Progress::Progress(std::string task, std::uint64_t total, bool quiet)
    : task_(std::move(task)),
      total_(total),
      json_(wants_json()),
      terminal_(!json_ && platform::stderr_is_terminal()),
      quiet_(quiet) {}

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
  if (json_ || terminal_) {
    if (now - last_draw_ < std::chrono::milliseconds(100) && done_ != total_) return;
    last_draw_ = now;
  }
  if (json_) {
    print_json(left_s);
  } else if (terminal_) {
    drawn_ = true;
    const int filled = static_cast<int>(fraction * 30);
    if (total_)
      fmt::print(stderr, "\r{} [{:#<{}}{:.<{}}] {}/{} {:.0f} s left \033[K", task_, "", filled, "", 30 - filled, done_,
                 total_, left_s);
    else
      fmt::print(stderr, "\r{} {}\033[K", task_, done_);
    std::fflush(stderr);
  } else if (total_) {
    const int tenth = static_cast<int>(fraction * 10);
    if (tenth <= last_tenth_) return;
    last_tenth_ = tenth;
    fmt::print(stderr, "{}: {}/{}, {:.0f} s left\n", task_, done_, total_, left_s);
  }
}

void Progress::print_json(double left_s) const {
  if (total_)
    fmt::print(stderr, "{{\"progress\": \"{}\", \"done\": {}, \"total\": {}, \"left_s\": {:.1f}}}\n", task_, done_,
               total_, left_s);
  else
    fmt::print(stderr, "{{\"progress\": \"{}\", \"done\": {}}}\n", task_, done_);
}

}  // namespace pecs
