#pragma once
// The readout: from events as pixels fire them to the events that the camera sends. A row arbiter serves the row that
// has waited longest; all its waiting pixels are read at once and get the time of that moment. Selecting a row takes
// time, and so does each vector of readout_vector_px pixels that has events. If a pixel fires again while it waits,
// that event is dropped and counted. Times are rounded down to the time base and may jitter, row by row; they never
// decrease.
#include <algorithm>
#include <cstdint>
#include <memory>
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
    std::uint16_t x;
    std::uint8_t p;
    Cause cause;
  };
  struct Request {
    std::uint16_t y;
    double t_us;
  };
  bool has_request() const { return first_ < queue_.size(); }
  double starts_us(double request_us) const { return std::max(free_us_, request_us); }
  void wait(const events::Event& e, Cause cause);
  // If no row waits: serves the rows of the events of one time directly, up to the time of the next event. Returns the
  // first event that is not served.
  std::size_t serve_at_once(const LabelledEvents& in, std::size_t first, LabelledEvents& out);
  void serve(LabelledEvents& out);
  // Service of a row: sets the time of its events; sends one event, in the order of x; ends the service.
  void stamp(double request_us);
  void send(events::Event e, Cause cause, LabelledEvents& out);
  void finish(double request_us);

  double row_us_, vector_us_, step_us_, jitter_us_;
  std::uint64_t seed_;
  std::size_t width_;
  int vector_px_;
  std::vector<std::vector<Waiting>> rows_;
  std::vector<bool> waits_;     // by pixel
  std::vector<Request> queue_;  // waiting rows, by their first event
  std::size_t first_ = 0;       // of the queue; the requests before it are served
  double free_us_ = 0;          // end of the row being sent
  int vector_ = -1;             // last vector of the row being sent
  std::int64_t vectors_ = 0;    // of this row
  std::int64_t served_ = 0, last_us_ = 0, dropped_ = 0;
  bool causes_ = false;
};

}  // namespace pecs::sensor
