#include "sense/event_sink.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

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
  stages_.begin_at(std::llround(timeline.t_us(0)));
  const StackInfo& info = timeline.source().info();
  const bool inside = options.frames == options.output;
  if (options.dropped) dropped_file_.emplace(*options.dropped, options.stages);  // first: it may be refused
  writer_ = events::open_writer(options.output, {info.width, info.height, chip.name, inside}, options.format);
  if (options.frames && !inside) frame_folder_.emplace(*options.frames, info.width, info.height);
  if (options.labels) causes_.emplace(*options.labels, "'|u1'");
  if (!options.ideal_readout && !is_ideal_readout(chip)) readout_.emplace(chip, info.width, info.height, options.seed);
}

bool EventSink::write(LabelledEvents& fired, bool last) {
  const std::int64_t from_us = timeline_.from_us(), to_us = timeline_.to_us();
  if (timeline_.loops() || timeline_.warmup_us() > 0) trim(fired, timeline_.read_out_from_us(), to_us);
  clear(sent_);
  for (const std::int64_t edge_us : {from_us, to_us}) {  // parts are inside the window or outside
    if (fired.events.empty() || fired.events.front().t_us >= edge_us || fired.events.back().t_us < edge_us) continue;
    LabelledEvents part = fired;
    trim(part, INT64_MIN, edge_us);
    trim(fired, edge_us, INT64_MAX);
    read_out(part, false);
  }
  read_out(fired, last);
  clear(fired);
  stages_.after_readout(sent_, last, &dropped_);
  note_dropped();
  trim(sent_, from_us, to_us);
  return send(sent_);
}

void EventSink::write(std::vector<events::Frame> frames) {
  for (events::Frame& frame : frames)
    if (frame_folder_)
      frame_folder_->write(frame);
    else
      writer_->write(std::move(frame));
}

// Appends what leaves the chip to sent_. `part` lies inside the output's window, whose losses are counted, or outside.
void EventSink::read_out(LabelledEvents& part, bool last) {
  const bool inside = !part.events.empty() && part.events.front().t_us >= timeline_.from_us() &&
                      part.events.front().t_us < timeline_.to_us();
  const std::int64_t lost = readout_ ? readout_->dropped() : 0;
  stages_.before_readout(part, &dropped_);
  if (readout_) {
    readout_->push(part, last, sent_);
  } else if (sent_.events.empty()) {
    std::swap(part, sent_);
  } else {
    sent_.events.insert(sent_.events.end(), part.events.begin(), part.events.end());
    sent_.causes.insert(sent_.causes.end(), part.causes.begin(), part.causes.end());
  }
  if (inside && readout_) lost_ += readout_->dropped() - lost;
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
  unsure_ += std::ranges::count(labelled.causes, Cause::unsure);
  if (causes_) causes_->write(std::as_bytes(std::span(labelled.causes)), labelled.causes.size());
  writer_->write(out);
  return !options_.watch || options_.watch(out);
}

void EventSink::close() {
  writer_->close();
  if (causes_) causes_->commit();
  if (dropped_file_) dropped_file_->commit();
  if (frame_folder_) frame_folder_->close();
}

Json EventSink::report() const {
  const double seconds = static_cast<double>(last_us_ - first_us_) * 1e-6;
  return {{"events", events_},
          {"on_fraction", events_ ? Json(static_cast<double>(on_) / static_cast<double>(events_)) : Json()},
          {"dropped", lost_},
          {"dropped_by_stage", counts_to_json(dropped_by_)},
          {"t_first_us", first_us_},
          {"t_last_us", last_us_},
          {"rate_hz", seconds > 0 ? Json(static_cast<double>(events_) / seconds) : Json()}};
}

}  // namespace pecs::sensor
