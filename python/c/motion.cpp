// Light and labels warped along motion.
#include "pecs/sensor/motion.h"

#include <tbb/task_arena.h>

#include <cmath>
#include <memory>
#include <vector>

#include "guard.h"
#include "handles.h"
#include "pecs/sensor/event_labels.h"

using pecs::capi::given;
using pecs::capi::guard;
using namespace pecs::sensor;

struct pecs_carrier {
  std::shared_ptr<const Carrier> motion;
  std::size_t pixels;
};

struct pecs_carried {
  std::shared_ptr<const Carrier> motion;
  CarriedLight light;
  std::size_t bands, pixels;
};

namespace {

CarrySide side_of(const char* side) {
  const std::string name = side ? side : "both";
  if (name == "both") return CarrySide::both;
  if (name == "first") return CarrySide::first;
  if (name == "second") return CarrySide::second;
  throw pecs::Error(pecs::ExitCode::usage, fmt::format("side: got {}, wanted both, first or second", name));
}

std::size_t positive(int64_t value, const char* name) {
  if (value < 1 || value > kMaxSide)
    throw pecs::Error(pecs::ExitCode::usage, fmt::format("{}: got {}, wanted 1 to {}", name, value, kMaxSide));
  return static_cast<std::size_t>(value);
}

void check_fraction(double fraction) {
  if (!(fraction >= 0 && fraction <= 1))
    throw pecs::Error(pecs::ExitCode::usage, fmt::format("fraction: got {}, wanted 0 to 1", fraction));
}

}  // namespace

extern "C" {

pecs_carrier* pecs_carrier_open(const float* motion, int channels, int width, int height, pecs_error* error) {
  return guard(error, [&] {
    const std::size_t pixels = positive(width, "width") * positive(height, "height");
    const std::size_t values = positive(channels, "channels") * pixels;
    return new pecs_carrier{std::make_shared<Carrier>(std::span(&given(motion, "motion"), values), width, height),
                            pixels};
  });
}

pecs_carried* pecs_carried_open(const pecs_carrier* carrier, const float* first, const float* second, int bands,
                                pecs_error* error) {
  return guard(error, [&] {
    const auto& [motion, pixels] = given(carrier, "carrier");
    const std::size_t count = positive(bands, "bands");
    given(first, "first"), given(second, "second");
    std::vector<const float*> a, b;
    for (std::size_t k = 0; k < count; ++k) {
      a.push_back(first + k * pixels);
      b.push_back(second + k * pixels);
    }
    return new pecs_carried{motion, {*motion, a, b}, count, pixels};
  });
}

int pecs_carried_at(const pecs_carried* light, double fraction, const char* side, const int32_t* boxes, int count,
                    float* out, int64_t capacity, pecs_error* error) {
  return guard(error, [&] {
    const auto& [motion, carried, bands, pixels] = given(light, "light");
    check_fraction(fraction);
    const CarrySide which = side_of(side);
    pecs::capi::need_room(static_cast<int64_t>(bands * pixels), capacity);
    given(out, "out");
    std::vector<float*> to;
    for (std::size_t k = 0; k < bands; ++k) to.push_back(out + k * pixels);
    std::vector<Box> parts;
    for (int k = 0; boxes && k < count; ++k, boxes += 4) parts.push_back({boxes[0], boxes[1], boxes[2], boxes[3]});
    carried.planes({&fraction, 1}, to, boxes ? std::span<const Box>(parts) : CarriedLight::kWhole, which);
    return 0;
  });
}

void pecs_carried_close(pecs_carried* light) { delete light; }

int pecs_carrier_labels(const pecs_carrier* carrier, const int32_t* first, const int32_t* second, double fraction,
                        int32_t* out, int64_t capacity, pecs_error* error) {
  return guard(error, [&] {
    const auto& [motion, pixels] = given(carrier, "carrier");
    check_fraction(fraction);
    pecs::capi::need_room(static_cast<int64_t>(pixels), capacity);
    given(first, "first"), given(second, "second"), given(out, "out");
    std::vector<Carrier::Sight> sights;
    for (std::size_t i = 0; i < pixels; ++i) sights.push_back({static_cast<std::int32_t>(i), fraction});
    motion->labels(first, second, sights, {out, pixels});
    return 0;
  });
}

void pecs_carrier_close(pecs_carrier* carrier) { delete carrier; }

int64_t pecs_event_labels(const pecs_event* events, int64_t count, const pecs_stack_reader* stack, const char* layer,
                          double begin_us, uint16_t* out, int64_t capacity, pecs_error* error) {
  return guard(error, [&] {
    const StackReader& reader = given(stack, "stack").reader;
    pecs::capi::check_count(count);
    if (!std::isfinite(begin_us)) throw pecs::Error(pecs::ExitCode::usage, "begin_us: got no number");
    pecs::capi::need_room(count, capacity);
    if (count) given(events, "events"), given(out, "out");
    const auto n = static_cast<std::size_t>(count);
    event_labels({reinterpret_cast<const pecs::events::Event*>(events), n}, reader, &given(layer, "layer"), begin_us,
                 {out, n});
    return count;
  });
}

}  // extern "C"
