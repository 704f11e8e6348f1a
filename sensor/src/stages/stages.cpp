#include "pecs/sensor/stages.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "pecs/error.h"

namespace pecs::sensor {
namespace {

using events::Event;

std::size_t pixels_of(int width, int height) {
  return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
}

// Number of the period; times may be below 0.
std::int64_t erc_period(std::int64_t t_us) { return (t_us - (t_us < 0 ? kErcPeriod_us - 1 : 0)) / kErcPeriod_us; }

constexpr std::int64_t kLongAgoUs = std::numeric_limits<std::int64_t>::min() / 4;

}  // namespace

// AFK. A pixel's period is the time between two of its changes from OFF to ON, so different thresholds of the pixels of
// a block do not disturb it; the block counts one of its pixels' periods at a time.
class EventStages::Blocks {
 public:
  Blocks(const Afk& afk, AfkCounts counts, int width, int height)
      : pass_(afk.pass),
        counts_(counts),
        shortest_us_(1e6 / afk.high_hz),
        longest_us_(1e6 / afk.low_hz),
        width_(static_cast<std::size_t>(width)),
        across_((width_ + 3) / 4),
        pixels_(pixels_of(width, height)),
        blocks_(across_ * ((static_cast<std::size_t>(height) + 3) / 4)) {}

  bool keeps(const Event& e) {
    Pixel& pixel = pixels_[e.y * width_ + e.x];
    Block& block = blocks_[e.y / 4 * across_ + e.x / 4];
    decay(block, e.t_us);
    if (e.p && !pixel.on) {
      const auto period_us = static_cast<double>(e.t_us - pixel.rise_us);
      if (period_us >= shortest_us_ && period_us <= longest_us_) count(block, e.t_us, period_us);
      pixel.rise_us = e.t_us;
    }
    pixel.on = e.p;
    return block.flickers == pass_;
  }

 private:
  struct Pixel {
    std::int64_t rise_us = kLongAgoUs;
    std::uint8_t on = 1;  // the first rise follows an OFF event
  };
  struct Block {
    std::int64_t counted_us = kLongAgoUs;  // last period counted or taken off
    std::int32_t periods = 0;
    bool flickers = false;
  };

  void decay(Block& block, std::int64_t t_us) const {
    if (block.periods == 0) return;
    const auto missed = static_cast<std::int64_t>(static_cast<double>(t_us - block.counted_us) / longest_us_);
    if (missed < 2) return;  // a period of the longest length may be under way
    block.periods = static_cast<std::int32_t>(std::max<std::int64_t>(0, block.periods - (missed - 1)));
    block.counted_us += static_cast<std::int64_t>(static_cast<double>(missed - 1) * longest_us_);
    if (block.periods < counts_.stop) block.flickers = false;
  }
  void count(Block& block, std::int64_t t_us, double period_us) const {
    if (static_cast<double>(t_us - block.counted_us) < 0.75 * period_us) return;  // another pixel's same period
    block.counted_us = t_us;
    block.periods = std::min(block.periods + 1, counts_.start);
    if (block.periods == counts_.start) block.flickers = true;
  }

  bool pass_;
  AfkCounts counts_;
  double shortest_us_, longest_us_;
  std::size_t width_, across_;
  std::vector<Pixel> pixels_;
  std::vector<Block> blocks_;
};

// Trail and STC.
class EventStages::Bursts {
 public:
  Bursts(TrailFilter kind, std::int64_t threshold_us, int width, int height)
      : kind_(kind),
        threshold_us_(threshold_us),
        width_(static_cast<std::size_t>(width)),
        pixels_(pixels_of(width, height)) {}

  bool keeps(const Event& e) {
    Pixel& pixel = pixels_[e.y * width_ + e.x];
    const bool goes_on = pixel.on == e.p && e.t_us - pixel.last_us < threshold_us_;
    const bool second = goes_on && pixel.first;
    pixel = {e.t_us, e.p, !goes_on};
    switch (kind_) {
      case TrailFilter::first:
        return !goes_on;
      case TrailFilter::second:
        return second;
      case TrailFilter::all_but_first:
        return goes_on;
    }
    return true;
  }

 private:
  struct Pixel {
    std::int64_t last_us = kLongAgoUs;
    std::uint8_t on = 0;  // polarity of the last event
    bool first = false;   // it began a burst
  };

  TrailFilter kind_;
  std::int64_t threshold_us_;
  std::size_t width_;
  std::vector<Pixel> pixels_;
};

EventStages::EventStages(const StageOptions& options, int width, int height) : width_(width), height_(height) {
  if (!options.roi.empty()) outside_.assign(pixels_of(width, height), true);
  for (const RoiWindow& w : options.roi) {
    if (w.x + w.width > width || w.y + w.height > height)
      throw bad_input("--roi", "window", fmt::format("{},{},{},{}", w.x, w.y, w.width, w.height),
                      fmt::format("one inside {}x{} pixels", width, height));
    for (int y = w.y; y < w.y + w.height; ++y)
      std::fill_n(outside_.begin() + std::ptrdiff_t{y} * width + w.x, w.width, false);
  }
  if (options.mask) masked_ = read_mask(*options.mask, width, height);
  if (options.afk_counts && !options.afk) throw Error(ExitCode::usage, "AFK: counts without a band");
  if (options.afk)
    afk_ = std::make_unique<Blocks>(*options.afk, options.afk_counts.value_or(AfkCounts{}), width, height);
  if (options.trail) trail_ = std::make_unique<Bursts>(*options.trail, options.trail_us, width, height);
  if (options.erc_hz > 0)
    most_ = std::max<std::int64_t>(1, std::llround(options.erc_hz * static_cast<double>(kErcPeriod_us) * 1e-6));
}

EventStages::~EventStages() = default;

void EventStages::before_readout(LabelledEvents& labelled, std::vector<DroppedEvent>* dropped) {
  if (outside_.empty()) return;
  auto& events = labelled.events;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < events.size(); ++i) {
    if (outside_[static_cast<std::size_t>(events[i].y) * static_cast<std::size_t>(width_) + events[i].x]) {
      if (dropped) dropped->push_back({events[i], Stage::roi});
      continue;
    }
    if (!labelled.causes.empty()) labelled.causes[kept] = labelled.causes[i];
    events[kept++] = events[i];
  }
  counts_[static_cast<std::size_t>(Stage::roi)] += std::ssize(events) - static_cast<std::int64_t>(kept);
  events.resize(kept);
  if (!labelled.causes.empty()) labelled.causes.resize(kept);
}

Stage EventStages::stage_of(const Event& e) {
  if (e.x >= width_ || e.y >= height_)
    throw bad_input("events", "pixel", fmt::format("({}, {})", e.x, e.y), fmt::format("one of {}x{}", width_, height_));
  const std::size_t pixel = static_cast<std::size_t>(e.y) * static_cast<std::size_t>(width_) + e.x;
  if (!masked_.empty() && masked_[pixel]) return Stage::mask;
  if (afk_ && !afk_->keeps(e)) return Stage::afk;
  if (trail_ && !trail_->keeps(e)) return Stage::trail;
  return Stage::none;
}

void EventStages::after_readout(LabelledEvents& labelled, bool last, std::vector<DroppedEvent>* dropped) {
  if (masked_.empty() && !afk_ && !trail_ && !most_) return;
  LabelledEvents out;
  const bool has_causes = !labelled.causes.empty();
  for (std::size_t i = 0; i < labelled.events.size(); ++i) {
    const Event& e = labelled.events[i];
    if (most_ && !held_.empty() && erc_period(e.t_us - begin_us_) != erc_period(held_.front().event.t_us - begin_us_))
      release(out, dropped);
    held_.push_back({e, has_causes ? labelled.causes[i] : Cause::signal, stage_of(e)});
  }
  if (last || !most_) release(out, dropped);
  if (!has_causes) out.causes.clear();
  std::swap(labelled, out);
}

// ERC keeps as many of a period's events as it may, evenly spread over their order.
void EventStages::release(LabelledEvents& out, std::vector<DroppedEvent>* dropped) {
  const std::int64_t waiting = std::ranges::count(held_, Stage::none, &Held::stage);
  const bool is_limited = most_ > 0 && waiting > most_;
  std::int64_t seen = 0;
  for (Held& h : held_) {
    if (h.stage == Stage::none && is_limited) {
      if ((seen + 1) * most_ / waiting == seen * most_ / waiting) h.stage = Stage::erc;
      ++seen;
    }
    if (h.stage == Stage::none) {
      out.events.push_back(h.event);
      out.causes.push_back(h.cause);
      continue;
    }
    ++counts_[static_cast<std::size_t>(h.stage)];
    if (dropped) dropped->push_back({h.event, h.stage});
  }
  held_.clear();
}

Json counts_to_json(const StageCounts& counts) {
  Json out = Json::object();
  for (std::size_t i = 1; i < counts.size(); ++i) out[kStageNames[i]] = counts[i];
  return out;
}

}  // namespace pecs::sensor
