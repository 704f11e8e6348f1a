// Bands, and the sensor on frames in memory.
#include "pecs/sensor/sensor.h"

#include <tbb/task_arena.h>

#include <algorithm>

#include "guard.h"
#include "pecs/sensor/choose_bands.h"

using pecs::capi::guard;

struct pecs_sensor {
  pecs::sensor::Sensor sensor;
  tbb::task_arena arena;
  pecs::sensor::LabelledEvents found;
};

namespace {

pecs_sensor* open_sensor(const pecs::Json& json) {
  using namespace pecs::sensor;
  pecs::JsonObject o(json, "options");
  std::vector<std::string> overrides;
  if (o.has("overrides")) {
    const pecs::Json& given = o.any("overrides");
    if (!given.is_object()) o.fail("overrides", given.dump().substr(0, 40), "{\"key\": value}");
    for (const auto& [key, value] : given.items()) overrides.push_back(key + "=" + value.dump());
  }
  const Chip chip = load_chip(o.text_or("chip", "imx636"), overrides);
  const int width = static_cast<int>(o.integer("width", 1, 8192)),
            height = static_cast<int>(o.integer("height", 1, 8192));
  const auto seed = static_cast<std::uint64_t>(o.integer_or("seed", 1, 0, std::numeric_limits<std::int64_t>::max()));
  const int threads = static_cast<int>(o.integer_or("threads", 0, 0, 1024));
  const double gain_fa = o.number("photocurrent_a", {1e-20, 1}) * 1e15;
  const bool no_noise = o.boolean_or("no_noise", false);
  ModelChoice model;
  model.name = o.text_or("model", "pecs");
  if (o.has("parameters")) {
    const pecs::Json& given = o.any("parameters");
    if (!given.is_object()) o.fail("parameters", given.dump().substr(0, 40), "{\"key\": value}");
    for (const auto& [key, value] : given.items()) {
      if (!value.is_number()) o.fail("parameters." + key, value.dump().substr(0, 40), "a number");
      model.parameters[key] = value.get<double>();
    }
  }
  const SensorExtras extras{!o.has("readout") || o.one_of("readout", {"chip", "ideal"}) == "chip",
                            o.boolean_or("labels", false)};
  o.done();
  return new pecs_sensor{Sensor(no_noise ? without_noise(chip) : chip, width, height, seed, gain_fa, model, extras),
                         tbb::task_arena(threads ? threads : tbb::task_arena::automatic),
                         {}};
}

}  // namespace

extern "C" {

char* pecs_bands(const char* options_json, pecs_error* error) {
  return guard(error, static_cast<char*>(nullptr), [&] {
    return pecs::capi::hand_over(pecs::sensor::choose_bands(pecs::parse_json(options_json, "options")).dump());
  });
}

pecs_sensor* pecs_sensor_open(const char* options_json, pecs_error* error) {
  return guard(error, static_cast<pecs_sensor*>(nullptr),
               [&] { return open_sensor(pecs::parse_json(options_json, "options")); });
}

int64_t pecs_sensor_push(pecs_sensor* sensor, const float* frames, const double* t_us, int64_t count, int last,
                         pecs_error* error) {
  return guard(error, std::int64_t{-1}, [&] {
    const auto pixels = static_cast<std::int64_t>(sensor->sensor.width()) * sensor->sensor.height();
    std::vector<const float*> planes;
    for (std::int64_t i = 0; i < count; ++i) planes.push_back(frames + i * pixels);
    sensor->found.events.clear();
    sensor->found.causes.clear();
    sensor->arena.execute(
        [&] { sensor->sensor.push(planes, {t_us, static_cast<std::size_t>(count)}, last != 0, sensor->found); });
    return static_cast<std::int64_t>(sensor->found.events.size());
  });
}

void pecs_sensor_events(const pecs_sensor* sensor, pecs_event* out) {
  std::ranges::copy(sensor->found.events, reinterpret_cast<pecs::events::Event*>(out));
}

void pecs_sensor_labels(const pecs_sensor* sensor, uint8_t* out) {
  std::ranges::transform(sensor->found.causes, out, [](auto cause) { return static_cast<std::uint8_t>(cause); });
}

int64_t pecs_sensor_dropped(const pecs_sensor* sensor) { return sensor->sensor.dropped(); }

void pecs_sensor_close(pecs_sensor* sensor) { delete sensor; }

}  // extern "C"
