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

CauseFile::CauseFile(const std::filesystem::path& path) : file_(path, AtomicFile::Order::goes_back) { write_header(); }

void CauseFile::write_header() {
  constexpr std::size_t kBytes = 128;  // a multiple of 64, as the format requires
  constexpr char kStart[] = {'\x93', 'N', 'U', 'M', 'P', 'Y', 1, 0, kBytes - 10, 0};
  const std::string text = fmt::format("{{'descr': '|u1', 'fortran_order': False, 'shape': ({},), }}", count_);
  file_.write(std::string_view(kStart, sizeof kStart));
  file_.write(fmt::format("{:<{}}\n", text, kBytes - sizeof kStart - 1));
}

void CauseFile::write(std::span<const Cause> causes) {
  file_.write(std::as_bytes(causes));
  count_ += causes.size();
}

void CauseFile::commit() {
  std::rewind(file_.stream());
  write_header();
  file_.commit();
}

EventSink::EventSink(const SenseOptions& options, const Chip& chip, const Timeline& timeline)
    : options_(options), timeline_(timeline) {
  const StackInfo& info = timeline.source().info();
  writer_ = events::open_writer(options.output, {info.width, info.height, chip.name}, options.format);
  if (options.labels) causes_.emplace(*options.labels);
  if (!options.ideal_readout && !is_ideal_readout(chip)) readout_.emplace(chip, info.width, info.height, options.seed);
}

bool EventSink::write(LabelledEvents& fired, bool last) {
  const std::int64_t from_us = timeline_.from_us(), to_us = timeline_.to_us();
  if (timeline_.loops()) trim(fired, from_us, to_us);  // the warm-up is not read out
  if (readout_) {
    clear(sent_);
    readout_->push(fired, last, sent_);
    clear(fired);
  }
  LabelledEvents& labelled = readout_ ? sent_ : fired;
  trim(labelled, from_us, to_us);
  const bool goes_on = send(labelled);
  clear(labelled);
  return goes_on;
}

bool EventSink::send(LabelledEvents& labelled) {
  auto& out = labelled.events;
  if (out.empty()) return !options_.watch || options_.watch({});
  for (events::Event& e : out) e.t_us -= timeline_.from_us();
  if (events_ == 0) first_us_ = out.front().t_us;
  last_us_ = out.back().t_us;
  events_ += std::ssize(out);
  on_ += std::ranges::count(out, 1, &events::Event::p);
  if (causes_) causes_->write(labelled.causes);
  writer_->write(out);
  return !options_.watch || options_.watch(out);
}

void EventSink::close() {
  writer_->close();
  if (causes_) causes_->commit();
}

Json EventSink::report() const {
  const double seconds = static_cast<double>(last_us_ - first_us_) * 1e-6;
  return {{"events", events_},
          {"on_fraction", events_ ? Json(static_cast<double>(on_) / static_cast<double>(events_)) : Json()},
          {"dropped", readout_ ? readout_->dropped() : 0},
          {"t_first_us", first_us_},
          {"t_last_us", last_us_},
          {"rate_hz", seconds > 0 ? Json(static_cast<double>(events_) / seconds) : Json()}};
}

}  // namespace pecs::sensor
