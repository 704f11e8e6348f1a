#pragma once
// Events that come from the renderer's noise. A second run simulates light that differs from that of the first as two
// renders with different samples do: I * exp(sqrt(2) n), where n is the stack's noise. Events of the first run without
// a partner in the second would not come again in another render.
#include <cstdint>
#include <vector>

#include "pecs/sensor/readout.h"
#include "pecs/strict_json.h"

namespace pecs::sensor {

class Repeats {
 public:
  // Partners are events of one pixel and polarity that are nearest to each other, and at most this far apart.
  static constexpr std::int64_t kWindow_us = 5000;

  // Counts events of [from_us, to_us).
  Repeats(int width, std::int64_t from_us, std::int64_t to_us) : width_(width), from_us_(from_us), to_us_(to_us) {}

  // Takes events of both runs, sorted by time across calls and complete before `until_us`, and empties both. Then
  // `first` receives the events whose partners are known (all of them with `last`), in their order. Signal events
  // without a partner get the cause Cause::render. The result does not depend on how events are divided into calls.
  void match(LabelledEvents& first, LabelledEvents& second, std::int64_t until_us, bool last);

  // "share": events of both runs without a partner, of all; "time_us": median difference of partners / sqrt(2), the
  // time error of events. Of both, since the second run has more noise (the first run's and its own): events of the
  // first one alone would find partners by chance.
  Json report() const;
  double share() const { return events_ ? static_cast<double>(alone_) / static_cast<double>(events_) : 0; }

 private:
  void decide(std::int64_t before_us);
  bool counts(const events::Event& e) const { return e.t_us >= from_us_ && e.t_us < to_us_; }

  int width_;
  std::int64_t from_us_, to_us_, decided_us_ = 0;
  LabelledEvents waiting_;                    // of the first run
  std::vector<events::Event> past_, others_;  // before them, and of the second run: as far as partners may be
  std::vector<std::int64_t> differences_ = std::vector<std::int64_t>(kWindow_us + 1);  // count by us
  std::int64_t events_ = 0, alone_ = 0, pairs_ = 0;
};

}  // namespace pecs::sensor
