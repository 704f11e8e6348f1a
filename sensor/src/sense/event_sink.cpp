#include "sense/event_sink.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>

namespace pecs::sensor {
namespace {

void clear(LabelledEvents& labelled) {
  labelled.events.clear();
  labelled.causes.clear();
}

// Keeps the events of [from_us, to_us).
void trim(LabelledEvents& labelled, std::int64_t from_us, std::int64_t to_us) {
  auto& events = labelled.events;
  const auto place = [&](std::int64_t t) {
    return std::ranges::lower_bound(events, t, {}, &events::Event::t_us) - events.begin();
  };
  const auto a = place(from_us), b = std::max(a, place(to_us));
  if (!labelled.causes.empty()) {
    labelled.causes.erase(labelled.causes.begin() + b, labelled.causes.end());
    labelled.causes.erase(labelled.causes.begin(), labelled.causes.begin() + a);
  }
  events.erase(events.begin() + b, events.end());
  events.erase(events.begin(), events.begin() + a);
}

}  // namespace

EventSink::EventSink(const SenseOptions& options, const Chip& chip, const Timeline& timeline)
    : options_(options),
      timeline_(timeline),
      stages_(options.stages, timeline.source().info().width, timeline.source().info().height) {
  const StackInfo& info = timeline.source().info();
  writer_ = events::open_writer(options.output, {info.width, info.height, chip.name}, options.format);
  if (options.labels) causes_.emplace(*options.labels, "'|u1'");
  if (options.dropped) dropped_file_.emplace(*options.dropped, options.stages);
  if (!options.ideal_readout && !is_ideal_readout(chip)) readout_.emplace(chip, info.width, info.height, options.seed);
}

bool EventSink::write(LabelledEvents& fired, bool last) {
  const std::int64_t from_us = timeline_.from_us(), to_us = timeline_.to_us();
  if (timeline_.warms_up()) trim(fired, from_us, to_us);  // the warm-up is not read out
  stages_.before_readout(fired);
  if (readout_) {
    clear(sent_);
    readout_->push(fired, last, sent_);
    clear(fired);
  }
  LabelledEvents& labelled = readout_ ? sent_ : fired;
  stages_.after_readout(labelled, last, &dropped_);
  note_dropped();
  trim(labelled, from_us, to_us);
  const bool goes_on = send(labelled);
  clear(labelled);
  return goes_on;
}

// Counts and writes the dropped events of the output's window.
void EventSink::note_dropped() {
  std::erase_if(dropped_, [&](const DroppedEvent& d) {
    return d.event.t_us < timeline_.from_us() || d.event.t_us >= timeline_.to_us();
  });
  for (DroppedEvent& d : dropped_) {
    ++dropped_by_[static_cast<std::size_t>(d.stage)];
    d.event.t_us -= timeline_.from_us();
  }
  if (dropped_file_) dropped_file_->write(dropped_);
  dropped_.clear();
}

bool EventSink::send(LabelledEvents& labelled) {
  auto& out = labelled.events;
  if (out.empty()) return !options_.watch || options_.watch({});
  for (events::Event& e : out) e.t_us -= timeline_.from_us();
  if (events_ == 0) first_us_ = out.front().t_us;
  last_us_ = out.back().t_us;
  events_ += std::ssize(out);
  on_ += std::ranges::count(out, 1, &events::Event::p);
  if (causes_) causes_->write(std::as_bytes(std::span(labelled.causes)), labelled.causes.size());
  writer_->write(out);
  return !options_.watch || options_.watch(out);
}

void EventSink::close() {
  writer_->close();
  if (causes_) causes_->commit();
  if (dropped_file_) dropped_file_->commit();
}

Json EventSink::report() const {
  const double seconds = static_cast<double>(last_us_ - first_us_) * 1e-6;
  StageCounts by_stage = dropped_by_;
  by_stage[static_cast<std::size_t>(Stage::roi)] = stages_.counts()[static_cast<std::size_t>(Stage::roi)];
  return {{"events", events_},
          {"on_fraction", events_ ? Json(static_cast<double>(on_) / static_cast<double>(events_)) : Json()},
          {"dropped", readout_ ? readout_->dropped() : 0},
          {"dropped_by_stage", counts_to_json(by_stage)},
          {"t_first_us", first_us_},
          {"t_last_us", last_us_},
          {"rate_hz", seconds > 0 ? Json(static_cast<double>(events_) / seconds) : Json()}};
}

}  // namespace pecs::sensor
