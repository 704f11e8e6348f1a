// Light and labels carried along the motion of an interval, whatever motion and light are.
#include "pecs/sensor/motion.h"

#include <tbb/task_arena.h>

#include <span>

#include "fuzz.h"

namespace {

using namespace pecs;
using sensor::Carrier;

// Bit-identical, except for the kind of NaN.
bool same(std::span<const float> a, std::span<const float> b) {
  return std::ranges::equal(a, b, [](float x, float y) { return x == y || (std::isnan(x) && std::isnan(y)); });
}

void carry(fuzz::Bytes in) {
  const int width = 1 + in.take<std::uint8_t>() % 80, height = 1 + in.take<std::uint8_t>() % 40;
  const std::size_t pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  constexpr std::size_t kChannels[] = {2, 4, sensor::kMotionChannels, sensor::kMotionChannels, 3};
  const Carrier carrier(fuzz::strange_floats(in, pixels * kChannels[in.take<std::uint8_t>() % 5]), width, height);
  if (const double path_px = carrier.longest_path_px(); !(path_px >= 0 && path_px < 1000))
    fuzz::defect("the longest path");

  const auto side = static_cast<sensor::CarrySide>(in.take<std::uint8_t>() % 3);
  const std::vector<double> all = carrier.instants(in.take<std::uint16_t>());
  std::vector<double> fractions = {in.take<std::uint8_t>() / 255.0, in.take<std::uint8_t>() / 255.0};
  if (!all.empty()) fractions.push_back(all[in.take<std::uint8_t>() % all.size()]);
  const std::vector<float> light[2] = {fuzz::strange_floats(in, pixels), fuzz::strange_floats(in, pixels)};
  const float* const planes[2] = {light[0].data(), light[1].data()};

  std::vector<std::vector<float>> together(fractions.size(), std::vector<float>(pixels));
  std::vector<float*> out;
  for (std::vector<float>& plane : together) out.push_back(plane.data());
  const sensor::CarriedLight carried(carrier, {planes, 1}, {planes + 1, 1});
  carried.planes(fractions, out, sensor::CarriedLight::kWhole, side);
  std::vector<float> alone(pixels);
  float* const one = alone.data();
  for (std::size_t i = 0; i < fractions.size(); ++i) {
    carried.planes({&fractions[i], 1}, {&one, 1}, sensor::CarriedLight::kWhole, side);
    if (!same(alone, together[i])) fuzz::defect("an instant alone is another than among others");
  }

  std::vector<std::int32_t> ids[2], labels;
  for (std::size_t i = 0; i < pixels; ++i) {
    ids[0].push_back(static_cast<std::int32_t>(i % 5));
    ids[1].push_back(static_cast<std::int32_t>(i % 7));
  }
  std::vector<Carrier::Sight> sights;
  for (const double fraction : fractions)
    for (std::size_t i = 0; i < pixels; i += 3) sights.push_back({static_cast<std::int32_t>(i), fraction});
  labels.resize(sights.size(), -1);
  carrier.labels(ids[0].data(), ids[1].data(), sights, labels);
  if (std::ranges::any_of(labels, [](std::int32_t id) { return id < 0 || id > 6; }))
    fuzz::defect("a label that nothing has");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static tbb::task_arena arena(1);
  fuzz::try_to([&] { arena.execute([&] { carry(fuzz::Bytes(fuzz::text(data, size))); }); });
  return 0;
}
