// Bands, and the sensor on frames in memory.
#include "pecs/sensor/sensor.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>

#include "guard.h"
#include "handles.h"
#include "pecs/sensor/choose_bands.h"
#include "pecs/sensor/sense_options.h"

using pecs::capi::given;
using pecs::capi::guard;
using namespace pecs::sensor;

struct pecs_sensor {
  Sensor sensor;
  tbb::task_arena arena;
  LabelledEvents found{};
  std::vector<pecs::events::Frame> frames{};
  bool finished = false;
  std::optional<pecs::TimeUnit> unit = {};  // of times, stated by the user
  pecs::FrameUnitCheck unit_check = {};
  std::int64_t not_finite = 0, negative = 0;
};

namespace {

pecs_sensor* open_sensor(const pecs::Json& json, const pecs_model* model) {
  pecs::JsonObject o(json, "options");
  SenseOptions options;
  read_sensor_options(o, options);
  pecs::capi::use_model(model, options.model);
  const Chip chip = chip_of(options, o.boolean_or("chip_frames", false), "chip_frames");
  const int width = static_cast<int>(o.integer("width", 1, kMaxSide)),
            height = static_cast<int>(o.integer("height", 1, kMaxSide));
  const double gain_fa = o.number("photocurrent_a", {1e-20, 1}) * 1e15;
  const SensorExtras extras{!options.ideal_readout, o.boolean_or("labels", false), !options.no_noise, options.stages};
  const auto unit = o.has("time_unit") ? std::optional(pecs::time_unit_from(o.text("time_unit"))) : std::nullopt;
  o.done();
  check_fits(chip, width, height, "frames");
  return new pecs_sensor{.sensor = Sensor(chip, width, height, options.seed, gain_fa, options.model, extras),
                         .arena = tbb::task_arena(options.threads ? options.threads : tbb::task_arena::automatic),
                         .unit = unit};
}

// In us.
std::vector<double> times_of(const pecs_sensor& sensor, std::span<const double> times) {
  const double us = std::pow(10.0, static_cast<int>(sensor.unit.value_or(pecs::TimeUnit::us)));
  std::vector<double> t_us(times.begin(), times.end());
  for (double& t : t_us) t *= us;
  return t_us;
}

// Whether all values are finite and >= 0.
bool all_light(std::span<const float> values) {
  std::atomic<bool> good = true;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, values.size(), 1 << 15), [&](const auto& range) {
    std::uint32_t top = 0;  // its highest bit: of a negative number, of infinity or NaN
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      const auto bits = std::bit_cast<std::uint32_t>(values[i]);
      top |= bits | (bits + 0x00800000u);
    }
    if (top >> 31) good = false;
  });
  return good;
}

// Frames as `pecs sense` reads them: negative light becomes 0, values that are not finite become NaN.
struct Sanitized {
  explicit Sanitized(std::span<const float> frames) : values(frames.begin(), frames.end()) {
    for (float& v : values) {
      if (!std::isfinite(v)) {
        v = std::numeric_limits<float>::quiet_NaN();
        ++not_finite;
      } else if (v < 0) {
        v = 0;
        ++negative;
      }
    }
  }
  std::vector<float> values;
  std::int64_t not_finite = 0, negative = 0;
};

// motion: null, or of so many channels a frame.
std::int64_t push(pecs_sensor& s, const float* frames, std::span<const double> times, const float* motion, int channels,
                  bool last) {
  if (s.finished) throw pecs::Error(pecs::ExitCode::usage, "frames: got some after the last");
  const std::vector<double> t_us = times_of(s, times);
  pecs::FrameUnitCheck unit_check = s.unit_check;
  for (const double t : t_us) unit_check.add(t);
  if (!s.unit) unit_check.check("frames");
  s.found.events.clear();
  s.found.causes.clear();
  s.arena.execute([&] {
    const auto pixels = static_cast<std::size_t>(s.sensor.width()) * static_cast<std::size_t>(s.sensor.height());
    std::optional<Sanitized> copy;
    if (const std::span values(frames, pixels * t_us.size()); !all_light(values))
      frames = copy.emplace(values).values.data();
    std::vector<const float*> planes;
    for (std::size_t i = 0; i < t_us.size(); ++i) planes.push_back(frames + i * pixels);
    if (motion)
      s.sensor.push_moving(planes, t_us, motion, static_cast<std::size_t>(channels), last, s.found);
    else
      s.sensor.push(planes, t_us, last, s.found);
    s.frames = s.sensor.take_frames();
    if (copy) s.not_finite += copy->not_finite, s.negative += copy->negative;
  });
  s.unit_check = unit_check;
  s.finished = last;
  return std::ssize(s.found.events);
}

void check_frames(const float* frames, const double* t_us, int64_t count) {
  pecs::capi::check_count(count);
  if (count > 0) given(frames, "frames"), given(t_us, "t_us");
}

}  // namespace

extern "C" {

char* pecs_bands(const char* options_json, pecs_error* error) {
  return guard(error, [&] { return pecs::capi::hand_over(choose_bands(pecs::capi::options_from(options_json))); });
}

pecs_sensor* pecs_sensor_open(const char* options_json, const pecs_model* model, pecs_error* error) {
  return guard(error, [&] { return open_sensor(pecs::capi::options_from(options_json), model); });
}

int64_t pecs_sensor_push(pecs_sensor* sensor, const float* frames, const double* t_us, int64_t count, int last,
                         pecs_error* error) {
  return guard(error, [&] {
    check_frames(frames, t_us, count);
    return push(given(sensor, "sensor"), frames, {t_us, static_cast<std::size_t>(count)}, nullptr, 0, last != 0);
  });
}

int64_t pecs_sensor_push_moving(pecs_sensor* sensor, const float* frames, const double* t_us, int64_t count,
                                const float* motion, int channels, int last, pecs_error* error) {
  return guard(error, [&] {
    check_frames(frames, t_us, count);
    if (channels < 1)
      throw pecs::Error(pecs::ExitCode::usage, fmt::format("channels: got {}, wanted 2, 4 or 20", channels));
    return push(given(sensor, "sensor"), frames, {t_us, static_cast<std::size_t>(count)}, &given(motion, "motion"),
                channels, last != 0);
  });
}

int64_t pecs_sensor_events(const pecs_sensor* sensor, pecs_event* out, int64_t capacity, pecs_error* error) {
  return guard(error, [&] {
    return pecs::capi::copy_out(given(sensor, "sensor").found.events, reinterpret_cast<pecs::events::Event*>(out),
                                capacity);
  });
}

int64_t pecs_sensor_labels(const pecs_sensor* sensor, uint8_t* out, int64_t capacity, pecs_error* error) {
  return guard(error, [&] {
    return pecs::capi::copy_out(given(sensor, "sensor").found.causes, reinterpret_cast<Cause*>(out), capacity);
  });
}

int64_t pecs_sensor_frames(const pecs_sensor* sensor, uint16_t* values, int64_t* exposures_us, int* bits,
                           int64_t capacity, pecs_error* error) {
  return guard(error, [&] {
    const auto& frames = given(sensor, "sensor").frames;
    if (capacity > 0) given(values, "values"), given(exposures_us, "exposures_us"), given(bits, "bits");
    for (std::size_t i = 0; i < frames.size() && static_cast<std::int64_t>(i) < capacity; ++i) {
      std::ranges::copy(frames[i].values, values + i * frames[i].values.size());
      exposures_us[2 * i] = frames[i].begin_us, exposures_us[2 * i + 1] = frames[i].end_us;
      *bits = frames[i].bits;
    }
    return std::ssize(frames);
  });
}

int64_t pecs_sensor_dropped(const pecs_sensor* sensor, pecs_error* error) {
  return guard(error, [&] { return given(sensor, "sensor").sensor.dropped(); });
}

char* pecs_sensor_dropped_by_stage(const pecs_sensor* sensor, pecs_error* error) {
  return guard(
      error, [&] { return pecs::capi::hand_over(counts_to_json(given(sensor, "sensor").sensor.dropped_by_stage())); });
}

int pecs_sensor_bad_values(const pecs_sensor* sensor, int64_t* not_finite, int64_t* negative, pecs_error* error) {
  return guard(error, [&] {
    const pecs_sensor& s = given(sensor, "sensor");
    if (not_finite) *not_finite = s.not_finite;
    if (negative) *negative = s.negative;
    return 0;
  });
}

void pecs_sensor_close(pecs_sensor* sensor) { delete sensor; }

}  // extern "C"
