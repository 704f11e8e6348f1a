// Chips, the photocurrent of a stack on them, and the pixel models.
#include "pecs/sensor/chip.h"

#include "guard.h"
#include "handles.h"
#include "pecs/sensor/pixel_model.h"
#include "pecs/sensor/sense_options.h"

using pecs::capi::given;
using pecs::capi::guard;
using namespace pecs::sensor;

struct pecs_chip {
  Chip chip;
};

namespace {

pecs::Json model_json(const std::string& name) {
  pecs::Json parameters = pecs::Json::array();
  for (const ModelParameter& p : model_parameters(name))
    parameters.push_back(
        {{"key", p.key}, {"unit", p.unit}, {"value", p.value}, {"min", p.min}, {"max", p.max}, {"meaning", p.meaning}});
  return {{"name", name},
          {"source", model_source(name)},
          {"takes_light", model_traits({name}).takes_light},
          {"tells_causes", model_traits({name}).tells_causes},
          {"parameters", parameters}};
}

// Data of a stack that the photocurrent depends on, without a stack on disk.
StackInfo light_from(pecs::JsonObject& o) {
  StackInfo info;
  const std::string quantity = o.one_of("quantity", {"irradiance", "radiance", "relative"});
  for (const Quantity q : {Quantity::irradiance, Quantity::radiance, Quantity::relative})
    if (quantity == name_of(q)) info.quantity = q;
  for (pecs::JsonObject& band : o.objects("bands")) {
    info.bands.push_back({band.number("lambda_nm", {100, 20000}), band.number("weight_nm", {0, 1e6})});
    band.done();
  }
  return info;
}

}  // namespace

extern "C" {

char* pecs_models(pecs_error* error) {
  return guard(error, [] {
    pecs::Json list = pecs::Json::array();
    for (const std::string& name : model_names()) list.push_back(model_json(name));
    return pecs::capi::hand_over(list);
  });
}

char* pecs_presets(pecs_error* error) {
  return guard(error, [] { return pecs::capi::hand_over(presets()); });
}

pecs_chip* pecs_chip_open(const char* path_or_name, const char* overrides_json, pecs_error* error) {
  return guard(error, [&] {
    return new pecs_chip{
        load_chip(&given(path_or_name, "chip"), overrides_from(pecs::capi::options_from(overrides_json)))};
  });
}

char* pecs_chip_info(const pecs_chip* chip, pecs_error* error) {
  return guard(error, [&] {
    const Chip& c = given(chip, "chip").chip;
    pecs::Json info = chip_to_json(c);
    for (const auto& [key, range] : c.ranges) info["values"][key]["range"] = {range.min, range.max};
    return pecs::capi::hand_over(info);
  });
}

char* pecs_chip_amperes_per_unit(const pecs_chip* chip, const char* options_json, pecs_error* error) {
  return guard(error, [&] {
    const pecs::Json json = pecs::capi::options_from(options_json);
    pecs::JsonObject o(json, "options");
    const StackInfo info = light_from(o);
    const PhotocurrentOptions light = read_photocurrent_options(o);
    o.done();
    const pecs::Json out = {{"amperes_per_unit", amperes_per_unit(given(chip, "chip").chip, info, light)}};
    return pecs::capi::hand_over(out);
  });
}

int64_t pecs_chip_photocurrent(const pecs_chip* chip, const pecs_stack_reader* stack, const char* options_json,
                               int64_t frame, float* out_a, int64_t capacity, pecs_error* error) {
  return guard(error, [&] {
    const pecs::Json json = pecs::capi::options_from(options_json);
    pecs::JsonObject o(json, "options");
    const PhotocurrentOptions light = read_photocurrent_options(o);
    o.done();
    const StackReader& reader = given(stack, "stack").reader;
    const Chip& of = given(chip, "chip").chip;
    const Response response(of, reader.info(), amperes_per_unit(of, reader.info(), light));
    const auto pixels = static_cast<std::size_t>(reader.info().width) * static_cast<std::size_t>(reader.info().height);
    std::vector<float> plane(pixels);
    PhotocurrentReader(reader, response).read(frame, 0, reader.info().height, plane.data());
    for (float& v : plane) v *= 1e-15f;
    return pecs::capi::copy_out(plane, out_a, capacity);
  });
}

void pecs_chip_close(pecs_chip* chip) { delete chip; }

}  // extern "C"
