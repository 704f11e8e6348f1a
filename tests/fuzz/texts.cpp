// The reader of one kind of text: fuzz::kKind.
#include "fuzz.h"
#include "pecs/lens/exchange.h"
#include "pecs/lens/prescription.h"
#include "pecs/sensor/chip.h"
#include "pecs/sensor/named_spectrum.h"
#include "pecs/sensor/sense_options.h"
#include "pecs/sensor/stack.h"

namespace {

using namespace pecs;

void load_lens(const fuzz::MemoryFile& file, const std::string& json) {
  file.hold(json);
  lens::load_prescription(file.path()).indices(550);
}

void read(const fuzz::MemoryFile& file, const std::string& text) {
  using fuzz::kKind;
  if (kKind == "chip") {
    file.hold(text);
    sensor::load_chip(file.path());
  } else if (kKind == "stack_json") {
    sensor::parse_stack_info(parse_json(text, "stack.json"), "stack.json");
  } else if (kKind == "options") {
    const Json json = parse_json(text, "options");
    sensor::sense_options(JsonObject(json, "options"));
  } else if (kKind == "spectrum") {
    file.hold(text);
    sensor::named_spectrum(file.path());
  } else if (kKind == "times") {
    file.hold(text);
    sensor::FrameTimes{.fps = {}, .file_us = file.path(), .unit = {}}.of(3, "times");
  } else if (kKind == "lens") {
    load_lens(file, text);
  } else if (kKind == "zemax") {
    load_lens(file, lens::import_zmx(text, "lens.zmx").dump());
  } else {
    load_lens(file, lens::import_pbrt(text, "lens.dat").dump());
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::MemoryFile file;
  fuzz::try_to([&] { read(file, std::string(fuzz::text(data, size))); });
  return 0;
}
