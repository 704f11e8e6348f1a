// EXR stacks: writer and reader.
#include "pecs/sensor/stack.h"

#include "guard.h"
#include "pecs/files.h"

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
std::size_t values_per_frame(const pecs::sensor::StackInfo& info) {
  return info.bands.size() * static_cast<std::size_t>(info.height) * static_cast<std::size_t>(info.width);
}
}  // namespace

extern "C" {

pecs_stack_writer* pecs_stack_create(const char* folder, const char* stack_json, pecs_error* error) {
  return guard(error, static_cast<pecs_stack_writer*>(nullptr), [&] {
    const std::string file = std::string(folder) + "/stack.json";
    return new pecs_stack_writer{StackWriter(folder, pecs::parse_json(stack_json, file))};
  });
}

int pecs_stack_has_frame(const pecs_stack_writer* stack, int64_t index) {
  return guard(nullptr, 0, [&] { return stack->writer.has_frame(index) ? 1 : 0; });
}

int pecs_stack_write_frame(pecs_stack_writer* stack, int64_t index, const float* values, pecs_error* error) {
  return guard(error, -1, [&] {
    stack->writer.write_frame(index, {values, values_per_frame(stack->writer.info())});
    return 0;
  });
}

void pecs_stack_close(pecs_stack_writer* stack) { delete stack; }

pecs_stack_reader* pecs_stack_open(const char* folder, double fps, pecs_error* error) {
  return guard(error, static_cast<pecs_stack_reader*>(nullptr), [&] {
    return new pecs_stack_reader{StackReader(folder, {fps > 0 ? std::optional(fps) : std::nullopt, {}})};
  });
}

char* pecs_stack_reader_info(const pecs_stack_reader* stack, pecs_error* error) {
  return guard(error, static_cast<char*>(nullptr), [&] {
    const auto& info = stack->reader.info();
    pecs::Json bands = pecs::Json::array();
    for (const auto& b : info.bands) bands.push_back({{"lambda_nm", b.lambda_nm}, {"weight_nm", b.weight_nm}});
    pecs::Json out = {{"quantity", name_of(info.quantity)},
                      {"width", info.width},
                      {"height", info.height},
                      {"bands", bands},
                      {"times_ns", info.times_ns},
                      {"frames", stack->reader.frames()},
                      {"pixel_pitch_m", nullptr},
                      {"period_ns", nullptr}};
    if (info.pixel_pitch_m) out["pixel_pitch_m"] = *info.pixel_pitch_m;
    if (info.period_ns) out["period_ns"] = *info.period_ns;
    return pecs::capi::hand_over(out.dump());
  });
}

int pecs_stack_read_frame(const pecs_stack_reader* stack, int64_t index, float* values, pecs_error* error) {
  return guard(error, -1, [&] {
    const std::vector<float> frame = stack->reader.read_frame(index);
    std::copy(frame.begin(), frame.end(), values);
    return 0;
  });
}

void pecs_stack_reader_close(pecs_stack_reader* stack) { delete stack; }

}  // extern "C"
