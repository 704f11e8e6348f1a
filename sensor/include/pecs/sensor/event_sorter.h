#pragma once
// From the keys that pixels add, in any order, to events in the stream's order: time, then pixel. The order does not
// depend on how they came.
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "pecs/sensor/event_slots.h"
#include "pecs/sensor/readout.h"

namespace pecs::sensor {

class EventSorter {
 public:
  // `causes`: events leave with their causes. Events before from_us may be left out.
  explicit EventSorter(int width, bool causes = false, std::int64_t from_us = 0)
      : width_(width), with_causes_(causes), from_us_(from_us) {}

  // Batch by batch. Events to come lie between these times; the better they are spread over them, the faster.
  void begin(std::span<const double> t_us);
  // Appends the events before `until_us` to `out`, sorted; keeps the others.
  void take(std::int64_t until_us, LabelledEvents& out);

  // Or: events of [from_us, to_us) are held, whatever their order, until all are there. What drop_outside() finds
  // beside them is forgotten. sink(events, last) then gets them, part by part.
  void begin_window(std::int64_t from_us, std::int64_t to_us);
  void drop_outside();
  void take_window(const std::function<void(LabelledEvents&, bool)>& sink);

  // To be filled; call for all before any is filled in parallel. Sorting is fastest when higher indices have higher
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
