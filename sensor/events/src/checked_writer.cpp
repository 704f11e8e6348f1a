#include "checked_writer.h"

#include <fmt/format.h>

#include <algorithm>

#include "pecs/error.h"

namespace pecs::events {

void Writer::write(Frame) { throw Error(ExitCode::internal, "frames in a format without them"); }

CheckedWriter::CheckedWriter(std::filesystem::path path, StreamInfo info, const Limits& limits, bool needs_size)
    : path_(std::move(path)), info_(std::move(info)), limits_(limits), last_t_us_(limits.t_min_us) {
  const bool given = info_.width > 0 && info_.height > 0, none = info_.width == 0 && info_.height == 0;
  if ((needs_size ? !given : !given && !none) || info_.width < 0 || info_.height < 0 || info_.width > limits.max_size ||
      info_.height > limits.max_size)
    throw bad_output(path_.string(), fmt::format("got a size of {}x{} pixels, wanted 1x1 to {}x{}", info_.width,
                                                 info_.height, limits.max_size, limits.max_size));
}

void CheckedWriter::write(std::span<const Event> events) {
  if (closed_) throw Error(ExitCode::internal, path_.string() + ": written to after close()");
  const int width = info_.width > 0 ? info_.width : limits_.max_size;
  const int height = info_.height > 0 ? info_.height : limits_.max_size;
  for (std::size_t i = 0; i < events.size(); ++i) {
    const Event& e = events[i];
    const auto refuse = [&](const std::string& got, const std::string& wanted) {
      return bad_input(path_.string(), fmt::format("event {}", count_ + i), got, wanted);
    };
    if (e.t_us < limits_.t_min_us || e.t_us > limits_.t_max_us)
      throw refuse(fmt::format("t = {} us", e.t_us),
                   fmt::format("{} to {} us (--rezero)", limits_.t_min_us, limits_.t_max_us));
    if (e.t_us < last_t_us_)
      throw refuse(fmt::format("t = {} us", e.t_us), fmt::format("at least {} us, the event before", last_t_us_));
    if (limits_.max_gap_us < INT64_MAX && e.t_us - std::max<std::int64_t>(last_t_us_, 0) >= limits_.max_gap_us)
      throw refuse(fmt::format("t = {} us, {} us after the event before", e.t_us, e.t_us - last_t_us_),
                   fmt::format("a gap below {} us (--rezero for the first)", limits_.max_gap_us));
    if (e.x >= width || e.y >= height)
      throw refuse(fmt::format("pixel ({}, {})", e.x, e.y), fmt::format("inside {}x{}", width, height));
    if (e.p > 1) throw refuse(fmt::format("p = {}", e.p), "0 or 1");
    last_t_us_ = e.t_us;
  }
  if (!events.empty()) put(events);
  count_ += events.size();
}

void CheckedWriter::close() {
  if (closed_) return;
  closed_ = true;
  finish();
}

void RunWriter::put(std::span<const Event> events) {
  constexpr std::size_t kBlock = 1 << 14;
  while (!events.empty()) {
    const auto block = events.first(std::min(kBlock, events.size()));
    rest_.insert(rest_.end(), block.begin(), block.end());
    put_runs(false);
    events = events.subspan(block.size());
  }
}

void RunWriter::finish() {
  put_runs(true);
  finish_file();
}

void RunWriter::put_runs(bool last) {
  std::size_t i = 0;
  while (i < rest_.size()) {
    const auto left = std::span<const Event>(rest_).subspan(i);
    const std::size_t n = run(left);
    if (n == left.size() && !last) break;
    i += put_run(left.first(n));
  }
  rest_.erase(rest_.begin(), rest_.begin() + static_cast<std::ptrdiff_t>(i));
}

}  // namespace pecs::events
