#pragma once
// The readout: from events as pixels fire them to the events that the camera sends. It serves lines, rows or columns
// of the chip: the line that has waited longest, or all in turn, and one without events then takes readout_idle_s. All
// waiting pixels of a line are read at once and get the time of that moment. Selecting a line takes time, and so does
// each vector of readout_vector_px pixels that has events. If a pixel fires again while it waits, that event is dropped
// and counted. Times are rounded down to the time base and may jitter, line by line; they never decrease.
#include <algorithm>
#include <cstdint>
#include <memory>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "pecs/events/event.h"
#include "pecs/sensor/chip.h"
#include "pecs/sensor/event_slots.h"

namespace pecs::sensor {

// Leaves new elements of a vector unwritten: the threads that fill them write them first.
template <class T>
struct GrowUnwritten : std::allocator<T> {
  GrowUnwritten() = default;
  template <class U>
  explicit GrowUnwritten(const GrowUnwritten<U>&) {}
  template <class U>
  struct rebind {
    using other = GrowUnwritten<U>;
  };
  template <class U>
  void construct(U*) noexcept {}
  template <class U, class... Arguments>
  void construct(U* at, Arguments&&... arguments) {
    std::construct_at(at, std::forward<Arguments>(arguments)...);
  }
};

struct LabelledEvents {
  std::vector<events::Event, GrowUnwritten<events::Event>> events;
  std::vector<Cause> causes;  // as many, or none
};

// Whether the chip sends events without delay, loss or rounding.
bool is_ideal_readout(const Chip& chip);

class Readout {
 public:
  Readout(const Chip& chip, int width, int height, std::uint64_t seed);
  // `in`: sorted by time, then pixel, across calls. Appends the events that have left the chip; `last`: also all that
  // wait.
  void push(const LabelledEvents& in, bool last, LabelledEvents& out);
  std::int64_t dropped() const { return dropped_; }

 private:
  struct Waiting {
    events::Event event;
    Cause cause;
  };
  struct Request {
    int line;
    double t_us;
  };
  bool in_turn() const { return idle_us_ > 0; }
  int line_of(const events::Event& e) const { return columns_ ? e.x : e.y; }
  int place_of(const events::Event& e) const { return columns_ ? e.y : e.x; }  // in its line
  bool has_request() const { return first_ < queue_.size(); }
  double starts_us(double request_us) const { return std::max(free_us_, request_us); }
  void wait(const events::Event& e, Cause cause);
  // If no row waits: serves the rows of the events of one time directly, up to the time of the next event. Returns the
  // first event that is not served.
  std::size_t serve_at_once(const LabelledEvents& in, std::size_t first, LabelledEvents& out);
  void serve(LabelledEvents& out);
  // Lines in turn: serves those that are reached before until_us.
  void visit(double until_us, LabelledEvents& out);
  void read(int line, double request_us, LabelledEvents& out);
  // Service of a line: sets the time of its events; sends one event, in the order of places; ends the service.
  void stamp(double request_us);
  void send(events::Event e, Cause cause, LabelledEvents& out);
  void finish(double request_us);

  double row_us_, vector_us_, idle_us_, step_us_, jitter_us_;
  std::uint64_t seed_;
  std::size_t width_;
  int vector_px_;
  bool columns_;
  std::vector<std::vector<Waiting>> lines_;
  std::vector<bool> waits_;     // by pixel
  std::vector<Request> queue_;  // waiting lines, by their first event
  std::size_t first_ = 0;       // of the queue; the requests before it are served
  std::set<int> waiting_;       // lines in turn: those with events
  int next_ = 0;                // lines in turn: the one that is visited at free_us_
  double free_us_ = 0;          // end of the line being sent
  int vector_ = -1;             // last vector of the line being sent
  std::int64_t vectors_ = 0;    // of this line
  std::int64_t served_ = 0, last_us_ = 0, dropped_ = 0;
  bool causes_ = false;
};

}  // namespace pecs::sensor
