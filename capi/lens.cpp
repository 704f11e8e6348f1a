#include "guard.h"
#include "pecs/lens/report.h"

struct pecs_lens {
  pecs::lens::Prescription prescription;
};

namespace {
// Calls use(options object) on parsed options and hands its JSON over.
template <class F>
char* answer(const char* options_json, pecs_error* error, F&& use) {
  return pecs::capi::guard(error, static_cast<char*>(nullptr), [&] {
    const pecs::Json options = pecs::parse_json(options_json ? options_json : "{}", "options");
    return pecs::capi::hand_over(use(pecs::JsonObject(options, "options")).dump());
  });
}
}  // namespace

extern "C" {

pecs_lens* pecs_lens_open(const char* path, pecs_error* error) {
  return pecs::capi::guard(error, static_cast<pecs_lens*>(nullptr),
                           [&] { return new pecs_lens{pecs::lens::load_prescription(path)}; });
}

void pecs_lens_close(pecs_lens* lens) { delete lens; }

char* pecs_lens_info(const pecs_lens* lens, const char* options_json, pecs_error* error) {
  return answer(options_json, error, [&](pecs::JsonObject options) {
    return pecs::lens::info(lens->prescription, pecs::lens::info_options(std::move(options)));
  });
}

char* pecs_lens_pupil(const pecs_lens* lens, const char* options_json, pecs_error* error) {
  return answer(options_json, error, [&](pecs::JsonObject options) {
    return pecs::lens::pupil_report(lens->prescription, pecs::lens::info_options(std::move(options)));
  });
}

char* pecs_lens_camera(const pecs_lens* lens, const char* options_json, pecs_error* error) {
  return answer(options_json, error, [&](pecs::JsonObject options) {
    const auto& prescription = lens->prescription;
    const auto resolved = pecs::lens::camera_options(prescription, std::move(options));
    return pecs::lens::camera_report(prescription, pecs::lens::make_camera(prescription, resolved));
  });
}

}  // extern "C"
