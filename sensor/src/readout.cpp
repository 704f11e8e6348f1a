#include "pecs/sensor/readout.h"

#include <algorithm>
#include <cmath>

#include "pecs/sensor/random.h"

namespace pecs::sensor {
namespace {

constexpr std::size_t kServed = 4096;  // requests that may stay in the queue

}  // namespace

bool is_ideal_readout(const Chip& chip) {
  return chip.readout_rate_hz == 0 && chip.readout_row_s == 0 && chip.clock_jitter_s == 0 && chip.timestamp_s <= 1e-6;
}

Readout::Readout(const Chip& chip, int width, int height, std::uint64_t seed)
    : row_us_(chip.readout_row_s * 1e6),
      event_us_(chip.readout_rate_hz > 0 ? 1e6 / chip.readout_rate_hz : 0),
      step_us_(chip.timestamp_s * 1e6),
      jitter_us_(chip.clock_jitter_s * 1e6),
      seed_(seed),
      width_(static_cast<std::size_t>(width)),
      rows_(static_cast<std::size_t>(height)),
      waits_(width_ * static_cast<std::size_t>(height)) {}

void Readout::push(const LabelledEvents& in, bool last, LabelledEvents& out) {
  causes_ |= !in.causes.empty();
  for (std::size_t i = 0; i < in.events.size(); ++i) {
    const events::Event& e = in.events[i];
    const auto t_us = static_cast<double>(e.t_us);
    while (has_request() && std::max(free_us_, queue_[first_].t_us) < t_us) serve(out);
    if (std::vector<bool>::reference waits = waits_[e.y * width_ + e.x]; waits) {
      ++dropped_;
      continue;
    } else {
      waits = true;
    }
    auto& row = rows_[e.y];
    if (row.empty()) queue_.push_back({e.y, t_us});
    row.push_back({e.x, e.p, causes_ ? in.causes[i] : Cause::signal});
  }
  while (last && has_request()) serve(out);
}

void Readout::serve(LabelledEvents& out) {
  const Request request = queue_[first_++];
  if (!has_request() || first_ == kServed) {
    queue_.erase(queue_.begin(), queue_.begin() + static_cast<std::ptrdiff_t>(first_));
    first_ = 0;
  }
  const double t_us = std::max(free_us_, request.t_us);
  auto& row = rows_[static_cast<std::size_t>(request.row)];
  if (row.size() > 1) std::ranges::sort(row, {}, &Waiting::x);
  double stamp_us = t_us;
  if (jitter_us_ > 0) stamp_us += jitter_us_ * gaussian(random4(seed_, 0, served_, Purpose::readout)[0]);
  // Rounded down; a time before the start counts as the start.
  const auto ticks = static_cast<double>(static_cast<std::int64_t>(stamp_us / step_us_));
  last_us_ = std::max(last_us_, static_cast<std::int64_t>(std::llround(ticks * step_us_)));
  for (const Waiting& w : row) {
    out.events.push_back({last_us_, w.x, static_cast<std::uint16_t>(request.row), w.p});
    if (causes_) out.causes.push_back(w.cause);
    waits_[static_cast<std::size_t>(request.row) * width_ + w.x] = false;
  }
  free_us_ = t_us + row_us_ + event_us_ * static_cast<double>(row.size());
  row.clear();
  ++served_;
}

}  // namespace pecs::sensor
