// EXR stacks: writer and reader.
#include "pecs/sensor/stack.h"

#include <algorithm>

#include "guard.h"
#include "handles.h"

using pecs::capi::given;
using pecs::capi::guard;
using pecs::sensor::StackReader;
using pecs::sensor::StackWriter;

struct pecs_stack_writer {
  StackWriter writer;
};

namespace {

// NULL means the light.
std::string_view layer_name(const char* layer) { return layer ? layer : pecs::sensor::kLight; }

std::size_t frame_values(const pecs::sensor::StackInfo& info, const char* layer, const std::filesystem::path& folder) {
  return pecs::sensor::frame_values(info, layer_of(info, layer_name(layer), folder));
}

}  // namespace

extern "C" {

pecs_stack_writer* pecs_stack_writer_create(const char* folder, const char* stack_json, pecs_error* error) {
  return guard(error, [&] {
    const std::string file = std::string(&given(folder, "folder")) + "/stack.json";
    return new pecs_stack_writer{StackWriter(folder, pecs::parse_json(&given(stack_json, "stack_json"), file))};
  });
}

int pecs_stack_writer_has_frame(const pecs_stack_writer* stack, const char* layer, int64_t index, pecs_error* error) {
  return guard(error, [&] { return given(stack, "stack").writer.has_frame(index, layer_name(layer)) ? 1 : 0; });
}

int pecs_stack_writer_write_frame(pecs_stack_writer* stack, const char* layer, int64_t index, const float* values,
                                  int64_t count, pecs_error* error) {
  return guard(error, [&] {
    if (count) given(values, "values");
    given(stack, "stack")
        .writer.write_frame(index, {values, static_cast<std::size_t>(std::max<int64_t>(count, 0))}, layer_name(layer));
    return 0;
  });
}

int pecs_stack_writer_has_between(const pecs_stack_writer* stack, int64_t interval, int64_t number, int64_t time_ns,
                                  pecs_error* error) {
  return guard(error, [&] { return given(stack, "stack").writer.has_between(interval, number, time_ns) ? 1 : 0; });
}

int pecs_stack_writer_write_between(pecs_stack_writer* stack, int64_t interval, int64_t number, int64_t time_ns,
                                    const float* values, int64_t count, pecs_error* error) {
  return guard(error, [&] {
    if (count) given(values, "values");
    given(stack, "stack")
        .writer.write_between(interval, number, time_ns,
                              {values, static_cast<std::size_t>(std::max<int64_t>(count, 0))});
    return 0;
  });
}

void pecs_stack_writer_close(pecs_stack_writer* stack) { delete stack; }

pecs_stack_reader* pecs_stack_reader_open(const char* folder, double fps, pecs_error* error) {
  return guard(error, [&] {
    return new pecs_stack_reader{
        StackReader(&given(folder, "folder"), {fps != 0 ? std::optional(fps) : std::nullopt, {}, {}})};
  });
}

char* pecs_stack_reader_info(const pecs_stack_reader* stack, pecs_error* error) {
  return guard(error, [&] {
    const StackReader& reader = given(stack, "stack").reader;
    const auto& info = reader.info();
    pecs::Json bands = pecs::Json::array(), layers = pecs::Json::array();
    for (const auto& b : info.bands) bands.push_back({{"lambda_nm", b.lambda_nm}, {"weight_nm", b.weight_nm}});
    for (const auto& layer : info.layers) layers.push_back(to_json(layer));
    const pecs::Json out = {{"quantity", name_of(info.quantity)},
                            {"width", info.width},
                            {"height", info.height},
                            {"subpixels", info.subpixels},
                            {"bands", bands},
                            {"layers", layers},
                            {"times_ns", info.times_ns},
                            {"frames", reader.frames()},
                            {"pixel_pitch_m", pecs::or_null(info.pixel_pitch_m)},
                            {"period_ns", pecs::or_null(info.period_ns)}};
    return pecs::capi::hand_over(out);
  });
}

int pecs_stack_reader_read_frame(const pecs_stack_reader* stack, const char* layer, int64_t index, float* values,
                                 int64_t capacity, pecs_error* error) {
  return guard(error, [&] {
    const StackReader& reader = given(stack, "stack").reader;
    pecs::capi::need_room(static_cast<int64_t>(frame_values(reader.info(), layer, reader.folder())), capacity);
    pecs::capi::copy_out(reader.read_frame(index, layer_name(layer)), values, capacity);
    return 0;
  });
}

int64_t pecs_stack_reader_between(const pecs_stack_reader* stack, int64_t interval, int64_t* times_ns, int64_t capacity,
                                  pecs_error* error) {
  return guard(error, [&] {
    const std::vector<std::int64_t> times = given(stack, "stack").reader.between_ns(interval);
    if (const auto room = std::clamp<int64_t>(capacity, 0, std::ssize(times)); room > 0)
      std::copy_n(times.begin(), room, &given(times_ns, "times_ns"));
    return static_cast<int64_t>(std::ssize(times));
  });
}

int pecs_stack_reader_read_between(const pecs_stack_reader* stack, int64_t interval, int64_t which, float* values,
                                   int64_t capacity, pecs_error* error) {
  return guard(error, [&] {
    const StackReader& reader = given(stack, "stack").reader;
    const std::int64_t count = std::ssize(reader.between_ns(interval));
    if (which < 0 || which >= count)
      throw pecs::bad_input(reader.folder().string(), "between", std::to_string(which),
                            "one of the interval's " + std::to_string(count));
    pecs::capi::need_room(static_cast<int64_t>(frame_values(reader.info(), nullptr, reader.folder())), capacity);
    pecs::capi::copy_out(reader.read_between(interval, static_cast<std::size_t>(which)), values, capacity);
    return 0;
  });
}

void pecs_stack_reader_close(pecs_stack_reader* stack) { delete stack; }

}  // extern "C"
