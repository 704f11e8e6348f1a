// EXR stacks: writer and reader.
#include "pecs/sensor/stack.h"

#include <fmt/format.h>

#include <algorithm>

#include "guard.h"
#include "pecs/error.h"

using pecs::capi::guard;
using pecs::sensor::StackReader;
using pecs::sensor::StackWriter;

struct pecs_stack_writer {
  StackWriter writer;
};
struct pecs_stack_reader {
  StackReader reader;
};

namespace {

// NULL is the light.
std::string_view layer_name(const char* layer) { return layer ? layer : pecs::sensor::kLight; }

std::size_t frame_values(const pecs::sensor::StackInfo& info, const char* layer, const std::filesystem::path& folder) {
  return pecs::sensor::frame_values(info, layer_of(info, layer_name(layer), folder));
}

pecs::Json json_of(const pecs::sensor::Layer& layer) {
  return {{"name", layer.name},
          {"channels", layer.channels},
          {"unit", layer.unit},
          {"at", layer.per_interval ? "interval" : "instant"}};
}

}  // namespace

extern "C" {

pecs_stack_writer* pecs_stack_writer_create(const char* folder, const char* stack_json, pecs_error* error) {
  return guard(error, static_cast<pecs_stack_writer*>(nullptr), [&] {
    const std::string file = std::string(folder) + "/stack.json";
    return new pecs_stack_writer{StackWriter(folder, pecs::parse_json(stack_json, file))};
  });
}

int pecs_stack_writer_has_frame(const pecs_stack_writer* stack, const char* layer, int64_t index, pecs_error* error) {
  return guard(error, -1, [&] { return stack->writer.has_frame(index, layer_name(layer)) ? 1 : 0; });
}

int pecs_stack_writer_write_frame(pecs_stack_writer* stack, const char* layer, int64_t index, const float* values,
                                  int64_t count, pecs_error* error) {
  return guard(error, -1, [&] {
    stack->writer.write_frame(index, {values, static_cast<std::size_t>(std::max<int64_t>(count, 0))},
                              layer_name(layer));
    return 0;
  });
}

void pecs_stack_writer_close(pecs_stack_writer* stack) { delete stack; }

pecs_stack_reader* pecs_stack_reader_open(const char* folder, double fps, pecs_error* error) {
  return guard(error, static_cast<pecs_stack_reader*>(nullptr), [&] {
    return new pecs_stack_reader{StackReader(folder, {fps > 0 ? std::optional(fps) : std::nullopt, {}})};
  });
}

char* pecs_stack_reader_info(const pecs_stack_reader* stack, pecs_error* error) {
  return guard(error, static_cast<char*>(nullptr), [&] {
    const auto& info = stack->reader.info();
    pecs::Json bands = pecs::Json::array(), layers = pecs::Json::array();
    for (const auto& b : info.bands) bands.push_back({{"lambda_nm", b.lambda_nm}, {"weight_nm", b.weight_nm}});
    for (const auto& layer : info.layers) layers.push_back(json_of(layer));
    pecs::Json out = {{"quantity", name_of(info.quantity)},
                      {"width", info.width},
                      {"height", info.height},
                      {"bands", bands},
                      {"layers", layers},
                      {"times_ns", info.times_ns},
                      {"frames", stack->reader.frames()},
                      {"pixel_pitch_m", nullptr},
                      {"period_ns", nullptr}};
    if (info.pixel_pitch_m) out["pixel_pitch_m"] = *info.pixel_pitch_m;
    if (info.period_ns) out["period_ns"] = *info.period_ns;
    return pecs::capi::hand_over(out.dump());
  });
}

int pecs_stack_reader_read_frame(const pecs_stack_reader* stack, const char* layer, int64_t index, float* values,
                                 int64_t capacity, pecs_error* error) {
  return guard(error, -1, [&] {
    const auto wanted = static_cast<int64_t>(frame_values(stack->reader.info(), layer, stack->reader.folder()));
    if (capacity < wanted)
      throw pecs::bad_input("values", "capacity", std::to_string(capacity), fmt::format("at least {}", wanted));
    const std::vector<float> frame = stack->reader.read_frame(index, layer_name(layer));
    std::copy(frame.begin(), frame.end(), values);
    return 0;
  });
}

void pecs_stack_reader_close(pecs_stack_reader* stack) { delete stack; }

}  // extern "C"
