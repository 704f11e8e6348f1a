#include "pecs/sensor/readout.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "pecs/sensor/random.h"

namespace pecs::sensor {
namespace {

constexpr std::size_t kServed = 4096;  // served requests that may stay in the queue

}  // namespace

bool is_ideal_readout(const Chip& chip) {
  return chip.readout_rate_hz == 0 && chip.readout_row_s == 0 && chip.readout_idle_s == 0 && chip.clock_jitter_s == 0 &&
         chip.timestamp_s <= 1e-6;
}

Readout::Readout(const Chip& chip, int width, int height, std::uint64_t seed)
    : row_us_(chip.readout_row_s * 1e6),
      vector_us_(chip.readout_rate_hz > 0 ? 1e6 * chip.readout_vector_px / chip.readout_rate_hz : 0),
      idle_us_(chip.readout_idle_s * 1e6),
      step_us_(chip.timestamp_s * 1e6),
      jitter_us_(chip.clock_jitter_s * 1e6),
      seed_(seed),
      width_(static_cast<std::size_t>(width)),
      vector_px_(static_cast<int>(chip.readout_vector_px)),
      columns_(chip.readout_columns > 0),
      lines_(static_cast<std::size_t>(columns_ ? width : height)),
      waits_(width_ * static_cast<std::size_t>(height)) {}

void Readout::push(const LabelledEvents& in, bool last, LabelledEvents& out) {
  causes_ |= !in.causes.empty();
  if (const std::size_t most = out.events.size() + in.events.size(); out.events.capacity() < most)
    out.events.reserve(std::max(most, 2 * out.events.capacity()));
  for (std::size_t i = 0; i < in.events.size();) {
    const std::int64_t t_us = in.events[i].t_us;
    if (in_turn()) {
      visit(static_cast<double>(t_us), out);
    } else {
      while (has_request() && starts_us(queue_[first_].t_us) < static_cast<double>(t_us)) serve(out);
      if (!columns_ && !has_request()) i = serve_at_once(in, i, out);
    }
    for (; i < in.events.size() && in.events[i].t_us == t_us; ++i)
      wait(in.events[i], causes_ ? in.causes[i] : Cause::signal);
  }
  while (last && has_request()) serve(out);
  if (last && in_turn()) visit(std::numeric_limits<double>::infinity(), out);
}

void Readout::wait(const events::Event& e, Cause cause) {
  if (std::vector<bool>::reference waits = waits_[e.y * width_ + e.x]; waits) {
    ++dropped_;
    return;
  } else {
    waits = true;
  }
  const int number = line_of(e);
  auto& line = lines_[static_cast<std::size_t>(number)];
  if (line.empty()) {
    if (in_turn())
      waiting_.insert(number);
    else
      queue_.push_back({number, static_cast<double>(e.t_us)});
  }
  line.push_back({e, cause});
}

std::size_t Readout::serve_at_once(const LabelledEvents& in, std::size_t first, LabelledEvents& out) {
  const auto& events = in.events;
  const std::int64_t t_us = events[first].t_us;
  std::size_t end = first;
  while (end < events.size() && events[end].t_us == t_us) ++end;
  if (end == events.size()) return first;  // more events of this time may follow
  const auto next_us = static_cast<double>(events[end].t_us);
  std::size_t i = first;
  while (i < end && starts_us(static_cast<double>(t_us)) < next_us) {
    const std::uint16_t y = events[i].y;
    stamp(static_cast<double>(t_us));
    for (const std::size_t begin = i; i < end && events[i].y == y; ++i) {
      if (i > begin && events[i].x == events[i - 1].x)
        ++dropped_;
      else
        send(events[i], causes_ ? in.causes[i] : Cause::signal, out);
    }
    finish(static_cast<double>(t_us));
  }
  return i;
}

void Readout::serve(LabelledEvents& out) {
  const Request request = queue_[first_++];
  if (!has_request()) {
    queue_.clear();
    first_ = 0;
  } else if (first_ == kServed) {
    queue_.erase(queue_.begin(), queue_.begin() + static_cast<std::ptrdiff_t>(first_));
    first_ = 0;
  }
  read(request.line, request.t_us, out);
}

void Readout::visit(double until_us, LabelledEvents& out) {
  const auto lines = static_cast<int>(lines_.size());
  while (!waiting_.empty()) {
    const auto found = waiting_.lower_bound(next_);
    const int line = found == waiting_.end() ? *waiting_.begin() : *found;
    const double reached_us = free_us_ + idle_us_ * ((line - next_ + lines) % lines);
    if (reached_us >= until_us) break;
    waiting_.erase(line);
    free_us_ = reached_us;
    read(line, reached_us, out);
    next_ = (line + 1) % lines;
  }
  if (const double passed = std::floor((until_us - free_us_) / idle_us_); passed > 0 && std::isfinite(passed)) {
    next_ = static_cast<int>(std::fmod(next_ + passed, lines));
    free_us_ += passed * idle_us_;
  }
}

void Readout::read(int number, double request_us, LabelledEvents& out) {
  auto& line = lines_[static_cast<std::size_t>(number)];
  if (line.size() > 1) std::ranges::sort(line, {}, [this](const Waiting& w) { return place_of(w.event); });
  stamp(request_us);
  for (const Waiting& w : line) {
    send(w.event, w.cause, out);
    waits_[w.event.y * width_ + w.event.x] = false;
  }
  finish(request_us);
  line.clear();
}

void Readout::stamp(double request_us) {
  double stamp_us = starts_us(request_us);
  if (jitter_us_ > 0) stamp_us += jitter_us_ * gaussian(random4(seed_, 0, served_, Purpose::readout)[0]);
  // Rounds down; times before the start become the start.
  const auto ticks = static_cast<std::int64_t>(step_us_ == 1 ? stamp_us : stamp_us / step_us_);
  last_us_ =
      std::max<std::int64_t>(last_us_, step_us_ == 1 ? ticks : std::llround(static_cast<double>(ticks) * step_us_));
}

void Readout::send(events::Event e, Cause cause, LabelledEvents& out) {
  const int vector = place_of(e) / vector_px_;
  vectors_ += vector != vector_;
  vector_ = vector;
  e.t_us = last_us_;
  out.events.push_back(e);
  if (causes_) out.causes.push_back(cause);
}

void Readout::finish(double request_us) {
  free_us_ = starts_us(request_us) + row_us_ + vector_us_ * static_cast<double>(vectors_);
  vector_ = -1;
  vectors_ = 0;
  ++served_;
}

}  // namespace pecs::sensor
