// The light of a stack at any time (pecs_light_*).
#include <tbb/task_arena.h>

#include "guard.h"
#include "pecs/sensor/light_sampler.h"
#include "pecs/sensor/photocurrent.h"
#include "pecs/sensor/sense_options.h"
#include "pecs/sensor/stack.h"

using pecs::capi::given;
using pecs::capi::guard;
using namespace pecs::sensor;

struct pecs_light {
  pecs_light(const char* folder, const FrameTimes& times) : reader(folder, times) {}
  StackReader reader;
  std::optional<LightSampler> light{};
  tbb::task_arena arena{};
};

namespace {

// [{"chip": name or path, "set": {...}}, ...]
std::vector<Chip> chips_of(pecs::JsonObject& o) {
  std::vector<Chip> chips;
  for (pecs::JsonObject& entry : o.objects("chips")) {
    const std::string name = entry.text("chip");
    chips.push_back(load_chip(name, entry.has("set") ? overrides_from(entry.any("set")) : std::vector<std::string>{}));
    entry.done();
  }
  if (chips.empty()) o.fail("chips", "none", "at least one");
  return chips;
}

pecs_light* open_light(const char* folder, const pecs::Json& json) {
  pecs::JsonObject o(json, "options");
  const std::vector<Chip> chips = chips_of(o);
  const PhotocurrentOptions options = read_photocurrent_options(o);
  const bool motion = o.boolean_or("motion", true);
  const auto threads = static_cast<int>(o.integer_or("threads", 0, 0, 1024));
  const std::optional<double> fps = o.maybe_number("fps", {1e-6, 1e9});
  o.done();
  auto out = std::make_unique<pecs_light>(folder, FrameTimes{fps, {}, {}});
  const StackInfo& info = out->reader.info();
  std::vector<Response> responses;
  for (const Chip& chip : chips) responses.emplace_back(chip, info, amperes_per_unit(chip, info, options), folder);
  out->light.emplace(out->reader, responses, motion);
  if (threads) out->arena.initialize(threads);
  return out.release();
}

}  // namespace

extern "C" {

pecs_light* pecs_light_open(const char* stack, const char* options_json, pecs_error* error) {
  return guard(error, [&] {
    return open_light(&given(stack, "stack"), pecs::capi::options_from(&given(options_json, "options")));
  });
}

char* pecs_light_info(const pecs_light* light, pecs_error* error) {
  return guard(error, [&] {
    const pecs_light& l = given(light, "light");
    const StackInfo& info = l.reader.info();
    return pecs::capi::hand_over(pecs::Json{{"chips", l.light->chips()},
                                            {"width", info.width},
                                            {"height", info.height},
                                            {"motion", l.light->along_motion()},
                                            {"end_us", info.period_ns ? pecs::Json() : pecs::Json(l.light->end_us())}});
  });
}

int64_t pecs_light_at(pecs_light* light, const double* t_us, int64_t count, float* out_a, int64_t capacity,
                      pecs_error* error) {
  return guard(error, [&] {
    pecs_light& l = given(light, "light");
    pecs::capi::check_count(count);
    if (count == 0) return int64_t{0};
    const auto values = static_cast<int64_t>(l.light->values());
    pecs::capi::need_room(count > INT64_MAX / values ? -1 : count * values, capacity);
    const std::span times(&given(t_us, "t_us"), static_cast<std::size_t>(count));
    const std::span out(&given(out_a, "out_a"), static_cast<std::size_t>(count * values));
    l.arena.execute([&] { l.light->at(times, out); });
    return count * values;
  });
}

int64_t pecs_light_exposure(pecs_light* light, double begin_us, double exposure_us, double row_delay_us, int64_t steps,
                            float* out_a, int64_t capacity, pecs_error* error) {
  return guard(error, [&] {
    pecs_light& l = given(light, "light");
    const auto values = static_cast<int64_t>(l.light->values());
    pecs::capi::need_room(values, capacity);
    const std::span out(&given(out_a, "out_a"), static_cast<std::size_t>(values));
    l.arena.execute([&] { l.light->exposure({begin_us, exposure_us, row_delay_us, steps}, out); });
    return values;
  });
}

void pecs_light_close(pecs_light* light) { delete light; }

}  // extern "C"
