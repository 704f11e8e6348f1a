// Events as planes and pictures.
#include "pecs/events/representations.h"

#include "guard.h"
#include "pecs/events/picture.h"

using pecs::capi::given;
using pecs::capi::guard;
using namespace pecs::events;

namespace {

std::span<const Event> span_of(const pecs_event* events, int64_t count) {
  pecs::capi::check_count(count);
  if (count) given(events, "events");
  return {reinterpret_cast<const Event*>(events), static_cast<std::size_t>(count)};
}

// Runs fill(events, out) on the caller's arrays; planes of which there are so many.
int fill_planes(const pecs_event* events, int64_t count, int width, int height, int64_t planes, float* out,
                int64_t capacity, const auto& fill) {
  const auto all = span_of(events, count);
  constexpr int64_t kMost = 1 << 16;  // of each; what is wrong then is said where the sizes are known
  const auto some = [&](int64_t n) { return std::clamp<int64_t>(n, 0, kMost); };
  const int64_t values = some(planes) * some(width) * some(height);
  pecs::capi::need_room(values, capacity);
  fill(all, std::span(values ? &given(out, "out") : out, static_cast<std::size_t>(values)));
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

int pecs_event_picture(const pecs_event* events, int64_t count, int width, int height, const char* theme, uint8_t* out,
                       int64_t capacity, pecs_error* error) {
  return guard(error, [&] {
    if (width < 1 || height < 1 || width > 65536 || height > 65536)
      throw pecs::Error(pecs::ExitCode::usage, fmt::format("size: got {}x{}, wanted 1 to 65536 each", width, height));
    pecs::capi::need_room(int64_t{3} * width * height, capacity);
    const auto pixels = picture(span_of(events, count), width, height, theme_of(&given(theme, "theme")));
    std::memcpy(&given(out, "out"), pixels.data(), pixels.size() * sizeof(Rgb));
    return 0;
  });
}

}  // extern "C"
