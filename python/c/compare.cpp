#include "pecs/metrics/compare.h"

#include <algorithm>

#include "guard.h"
#include "pecs/page/page.h"

namespace {

// The layouts are equal: python/c/events.cpp asserts it.
pecs::events::Stream stream_of(const pecs_event* events, int64_t count, int width, int height, const char* name) {
  if (count < 0 || (count > 0 && !events)) throw pecs::bad_input(name, "", "no events", "an array of them");
  const auto* first = reinterpret_cast<const pecs::events::Event*>(events);
  pecs::events::Stream stream{{width, height, ""}, {first, first + count}};
  for (std::size_t i = 0; i < stream.events.size(); ++i) {
    const auto& e = stream.events[i];
    if (e.x >= width || e.y >= height || e.p > 1)
      throw pecs::bad_input(name, fmt::format("event {}", i), fmt::format("x {} y {} p {}", e.x, e.y, e.p),
                            fmt::format("x < {}, y < {}, p 0 or 1", width, height));
  }
  return stream;
}

}  // namespace

extern "C" char* pecs_compare(const pecs_event* real, int64_t real_count, const pecs_event* sim, int64_t sim_count,
                              const char* options_json, pecs_error* error) {
  return pecs::capi::guard(error, [&] {
    const pecs::Json json = pecs::capi::options_from(options_json);
    pecs::JsonObject object(json, "options");
    const auto width = static_cast<int>(object.integer("width", 1, 65536));
    const auto height = static_cast<int>(object.integer("height", 1, 65536));
    const auto sim_width = static_cast<int>(object.integer_or("sim_width", width, 1, 65536));
    const auto sim_height = static_cast<int>(object.integer_or("sim_height", height, 1, 65536));
    pecs::metrics::CompareOptions options;
    options.normalisation = pecs::metrics::normalisation_from(object.text_or("normalisation", "shared"));
    if (object.has("window_us")) options.window_us = object.integer("window_us", 1, std::int64_t{1} << 52);
    if (object.has("origin")) options.common_origin = object.one_of("origin", {"first-event", "zero"}) == "zero";
    options.split_half = object.boolean_or("split_half", true);
    options.seed = static_cast<std::uint64_t>(object.integer_or("seed", 1, 0, std::int64_t{1} << 62));
    options.realism = object.boolean_or("realism", false);
    if (object.has("disk")) options.disk = pecs::metrics::turning_disk_from(object.object("disk"));
    object.done();

    const auto comparison =
        pecs::metrics::compare(stream_of(real, real_count, width, height, "real"), "real",
                               stream_of(sim, sim_count, sim_width, sim_height, "sim"), "sim", options);
    return pecs::capi::hand_over(pecs::metrics::to_json(comparison));
  });
}

extern "C" char* pecs_delays(const pecs_event* events, int64_t count, const char* options_json, pecs_error* error) {
  return pecs::capi::guard(error, [&] {
    const pecs::Json json = pecs::capi::options_from(options_json);
    pecs::JsonObject object(json, "options");
    const auto width = static_cast<int>(object.integer("width", 1, 65536));
    const auto height = static_cast<int>(object.integer("height", 1, 65536));
    const std::int64_t end_us = object.integer("duration_us", 1, std::int64_t{1} << 52);
    const auto disk = pecs::metrics::turning_disk_from(object.object("disk"));
    object.done();
    const auto stream = stream_of(events, count, width, height, "events");
    const auto& all = stream.events;
    const auto later = [](const auto& a, const auto& b) { return a.t_us < b.t_us; };
    if (!std::is_sorted(all.begin(), all.end(), later))
      throw pecs::bad_input("events", "t", "a time that goes back", "events in time order");
    const auto measured = pecs::metrics::measure_delays(all, width, height, end_us, disk);
    return pecs::capi::hand_over(pecs::metrics::to_json(measured));
  });
}

extern "C" char* pecs_page(const char* page_json, pecs_error* error) {
  return pecs::capi::guard(error, [&] {
    const std::string text = &pecs::capi::given(page_json, "page");
    return pecs::capi::hand_over(pecs::page::page_of(pecs::parse_json(text, "page")));
  });
}
