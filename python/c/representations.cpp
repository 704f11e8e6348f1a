// Events as planes.
#include "pecs/events/representations.h"

#include "guard.h"

using pecs::capi::given;
using pecs::capi::guard;
using namespace pecs::events;

namespace {

// Runs fill(events, out) on the caller's arrays; planes of which there are so many.
int fill_planes(const pecs_event* events, int64_t count, int width, int height, int64_t planes, float* out,
                int64_t capacity, const auto& fill) {
  pecs::capi::check_count(count);
  if (count) given(events, "events");
  constexpr int64_t kMost = 1 << 16;  // of each; what is wrong then is said where the sizes are known
  const auto some = [&](int64_t n) { return std::clamp<int64_t>(n, 0, kMost); };
  const int64_t values = some(planes) * some(width) * some(height);
  pecs::capi::need_room(values, capacity);
  fill(std::span(reinterpret_cast<const Event*>(events), static_cast<std::size_t>(count)),
       std::span(values ? &given(out, "out") : out, static_cast<std::size_t>(values)));
  return 0;
}

}  // namespace

extern "C" {

int pecs_voxel_grid(const pecs_event* events, int64_t count, int width, int height, int bins, double begin_us,
                    double end_us, int normalise, float* out, int64_t capacity, pecs_error* error) {
  return guard(error, [&] {
    return fill_planes(events, count, width, height, bins, out, capacity, [&](auto some, auto to) {
      voxel_grid(some, {width, height, begin_us, end_us}, bins, normalise != 0, to);
    });
  });
}

int pecs_time_surface(const pecs_event* events, int64_t count, int width, int height, double begin_us, double end_us,
                      double tau_us, float* out, int64_t capacity, pecs_error* error) {
  return guard(error, [&] {
    return fill_planes(events, count, width, height, 2, out, capacity,
                       [&](auto some, auto to) { time_surface(some, {width, height, begin_us, end_us}, tau_us, to); });
  });
}

int pecs_event_histogram(const pecs_event* events, int64_t count, int width, int height, int bins, double begin_us,
                         double end_us, float* out, int64_t capacity, pecs_error* error) {
  return guard(error, [&] {
    return fill_planes(events, count, width, height, 2 * int64_t{bins}, out, capacity,
                       [&](auto some, auto to) { event_histogram(some, {width, height, begin_us, end_us}, bins, to); });
  });
}

}  // extern "C"
