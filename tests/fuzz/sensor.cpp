// The sensor over whatever light: its events are sorted and inside the picture, and the same however frames come.
#include "pecs/sensor/sensor.h"

#include <tbb/task_arena.h>

#include <array>

#include "check_events.h"
#include "fuzz.h"

namespace {

using namespace pecs;

struct Scene {
  int width, height;
  std::vector<std::vector<float>> planes;
  std::vector<double> t_us;
  std::vector<float> motion;  // flow before each plane, or none
};

decltype(sensor::LabelledEvents::events) events_of(const Scene& scene, sensor::Sensor sensor, std::size_t at_once) {
  sensor::LabelledEvents out;
  const std::size_t pixels = scene.planes[0].size();
  for (std::size_t i = 0; i < scene.planes.size(); i += at_once) {
    const std::size_t n = std::min(at_once, scene.planes.size() - i);
    std::vector<const float*> planes;
    for (std::size_t k = i; k < i + n; ++k) planes.push_back(scene.planes[k].data());
    const std::span times = std::span(scene.t_us).subspan(i, n);
    const bool last = i + n == scene.planes.size();
    if (scene.motion.empty())
      sensor.push(planes, times, last, out);
    else
      sensor.push_moving(planes, times, scene.motion.data() + 2 * pixels * i, 2, last, out);
  }
  return out.events;
}

void sense(fuzz::Bytes in) {
  static const std::array chips = {sensor::load_chip("ideal"), sensor::load_chip("imx636"),
                                   sensor::load_chip("davis346"), sensor::without_noise(sensor::load_chip("imx636"))};
  static const std::vector<std::string> models = sensor::model_names();
  const sensor::Chip& chip = chips[in.take<std::uint8_t>() % chips.size()];
  const auto kind = in.take<std::uint8_t>();
  const sensor::ModelChoice model{.name = kind < 128 ? "pecs" : models[kind % models.size()]};
  const sensor::SensorExtras extras{.readout = (kind & 1) != 0};
  Scene scene{1 + in.take<std::uint8_t>() % 40, 1 + in.take<std::uint8_t>() % 4, {}, {}, {}};
  const std::size_t pixels = static_cast<std::size_t>(scene.width) * static_cast<std::size_t>(scene.height);
  const std::size_t frames = 1 + in.take<std::uint8_t>() % 8;
  double t_us = 0;
  for (std::size_t i = 0; i < frames; ++i) {
    scene.planes.push_back(fuzz::strange_floats(in, pixels));
    scene.t_us.push_back(t_us);
    t_us += in.take<std::uint16_t>() / (i % 2 ? 1.0 : 64.0);
  }
  if (kind & 2) scene.motion = fuzz::strange_floats(in, 2 * pixels * frames);

  const auto sensor = [&] {
    return sensor::Sensor(chip, scene.width, scene.height, kind, in.rest().size() % 2 ? 1 : 1000, model, extras);
  };
  const auto all = events_of(scene, sensor(), frames);
  fuzz::check(all, scene.width, scene.height);
  if (all != events_of(scene, sensor(), 1)) fuzz::defect("other events frame by frame");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static tbb::task_arena arena(1);
  fuzz::try_to([&] { arena.execute([&] { sense(fuzz::Bytes(fuzz::text(data, size))); }); });
  return 0;
}
