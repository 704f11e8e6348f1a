#pragma once
// The readout: from when pixels fire to what the camera sends. A row arbiter serves one row at a time, the row that
// has waited longest; all its waiting pixels are read at once and get the time of that moment. Selecting a row and
// sending its events take time. A pixel that fires again while it waits has no second event: it is dropped and
// counted. Times are rounded down to the time base and may jitter, row by row; they never go back.
#include <algorithm>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "pecs/events/event.h"
#include "pecs/sensor/chip.h"
#include "pecs/sensor/event_key.h"

namespace pecs::sensor {

// Lets a vector grow by elements that are written at once, and by the threads that fill them.
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

// Whether the chip sends events as they come.
bool is_ideal_readout(const Chip& chip);

class Readout {
 public:
  Readout(const Chip& chip, int width, int height, std::uint64_t seed);
  // `in` in the stream's order (time, then pixel), from call to call; appends what has left the chip. `last`: all that
  // waits leaves too.
  void push(const LabelledEvents& in, bool last, LabelledEvents& out);
  std::int64_t dropped() const { return dropped_; }

 private:
  struct Waiting {
    std::uint16_t x;
    std::uint8_t p;
    Cause cause;
  };
  struct Request {
    std::uint16_t row;
    double t_us;
  };
  bool has_request() const { return first_ < queue_.size(); }
  double starts_us(double request_us) const { return std::max(free_us_, request_us); }
  void wait(const events::Event& e, Cause cause);
  // When nobody waits: the rows of the events of one time, as far as they are served before the next event comes.
  // Returns the first event that is not served.
  std::size_t serve_at_once(const LabelledEvents& in, std::size_t first, LabelledEvents& out);
  void serve(LabelledEvents& out);
  // Of a row: the time that its events get; an event; the end of its service.
  void stamp(double request_us);
  void send(events::Event e, Cause cause, LabelledEvents& out) const;
  void finish(double request_us, std::size_t sent);

  double row_us_, event_us_, step_us_, jitter_us_;
  std::uint64_t seed_;
  std::size_t width_;
  std::vector<std::vector<Waiting>> rows_;
  std::vector<bool> waits_;     // by pixel
  std::vector<Request> queue_;  // rows that wait, in the order of their first event
  std::size_t first_ = 0;       // of the queue: those before are served
  double free_us_ = 0;          // end of the row being sent
  std::int64_t served_ = 0, last_us_ = 0, dropped_ = 0;
  bool causes_ = false;
};

}  // namespace pecs::sensor
