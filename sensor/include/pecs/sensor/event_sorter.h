#pragma once
// Sorts the keys that pixels add into events, by time, then pixel. The result does not depend on the order in which
// they were added.
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "pecs/sensor/event_slots.h"
#include "pecs/sensor/readout.h"

namespace pecs::sensor {

class EventSorter {
 public:
  // `causes`: events have causes. Events before from_us may be left out.
  explicit EventSorter(int width, bool causes = false, std::int64_t from_us = 0)
      : width_(width), with_causes_(causes), from_us_(from_us) {}

  // Batch by batch: the next events lie between these times. Sorting is fastest if they are spread evenly over them.
  void begin(std::span<const double> t_us);
  // Appends the events before `until_us` to `out`, sorted; keeps the others.
  void take(std::int64_t until_us, LabelledEvents& out);

  // Or by window: holds events of [from_us, to_us) until all are added; drop_outside() discards all others. Then
  // take_window() passes them to sink(events, last), part by part.
  void begin_window(std::int64_t from_us, std::int64_t to_us);
  void drop_outside();
  void take_window(const std::function<void(LabelledEvents&, bool)>& sink);

  // A part to fill. Create all parts before filling them in parallel. Sorting is fastest if higher indices hold higher
  // pixels.
  EventSlots& part(std::size_t index);

 private:
  void append_sorted(std::size_t first_slot, std::size_t end_slot, LabelledEvents& out);

  int width_;
  bool with_causes_;
  std::int64_t from_us_;
  std::vector<EventKey> edges_;  // of the slots
  std::vector<EventSlots> parts_;
  std::vector<EventKey> held_;
  std::size_t window_first_ = 0;  // slot of from_us
};

}  // namespace pecs::sensor
