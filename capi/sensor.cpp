// Bands (pecs_bands): JSON in, JSON out.
#include "guard.h"
#include "pecs/sensor/choose_bands.h"

extern "C" char* pecs_bands(const char* options_json, pecs_error* error) {
  return pecs::capi::guard(error, static_cast<char*>(nullptr), [&] {
    return pecs::capi::hand_over(pecs::sensor::choose_bands(pecs::parse_json(options_json, "options")).dump());
  });
}
