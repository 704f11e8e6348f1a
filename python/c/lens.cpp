#include <tbb/parallel_for.h>

#include <cmath>
#include <limits>
#include <memory>
#include <mutex>
#include <utility>

#include "guard.h"
#include "pecs/error.h"
#include "pecs/lens/diffraction.h"
#include "pecs/lens/draw.h"
#include "pecs/lens/report.h"

struct pecs_lens {
  using Map = std::shared_ptr<const pecs::lens::ImageMap>;
  pecs::lens::Prescription prescription;
  // The image map of the last options, which takes longer to make than to ask for a picture's pixels.
  mutable std::mutex mutex = {};
  mutable std::pair<std::string, Map> last = {};
};

namespace {
// Calls use(prescription, options object) and hands its JSON over.
template <class F>
char* answer(const pecs_lens* lens, const char* options_json, pecs_error* error, F&& use) {
  return pecs::capi::guard(error, [&] {
    const pecs::Json options = pecs::capi::options_from(options_json);
    const auto& prescription = pecs::capi::given(lens, "lens").prescription;
    return pecs::capi::hand_over(use(prescription, pecs::JsonObject(options, "options")));
  });
}

pecs_lens::Map image_map(const pecs_lens* lens, const char* options_json) {
  const auto& [prescription, mutex, last] = pecs::capi::given(lens, "lens");
  const pecs::Json options = pecs::capi::options_from(options_json);
  std::string key = options.dump();
  const std::lock_guard lock(mutex);
  if (!last.second || last.first != key) {
    const auto setting = pecs::lens::image_setting(prescription, pecs::JsonObject(options, "options"));
    last = {std::move(key), std::make_shared<const pecs::lens::ImageMap>(prescription, setting)};
  }
  return last.second;
}

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
}  // namespace

extern "C" {

pecs_lens* pecs_lens_open(const char* path_or_name, pecs_error* error) {
  return pecs::capi::guard(error, [&] {
    return new pecs_lens{.prescription = pecs::lens::load_prescription(&pecs::capi::given(path_or_name, "path"))};
  });
}

void pecs_lens_close(pecs_lens* lens) { delete lens; }

char* pecs_lens_info(const pecs_lens* lens, const char* options_json, pecs_error* error) {
  return answer(lens, options_json, error, [](const auto& prescription, pecs::JsonObject options) {
    return pecs::lens::info(prescription, pecs::lens::info_options(std::move(options)));
  });
}

char* pecs_lens_pupil(const pecs_lens* lens, const char* options_json, pecs_error* error) {
  return answer(lens, options_json, error, [](const auto& prescription, pecs::JsonObject options) {
    return pecs::lens::pupil_report(prescription, pecs::lens::info_options(std::move(options)));
  });
}

char* pecs_lens_camera(const pecs_lens* lens, const char* options_json, pecs_error* error) {
  return answer(lens, options_json, error, [](const auto& prescription, pecs::JsonObject options) {
    const auto resolved = pecs::lens::camera_options(prescription, std::move(options));
    return pecs::lens::camera_report(prescription, pecs::lens::make_camera(prescription, resolved));
  });
}

char* pecs_lens_draw(const pecs_lens* lens, const char* options_json, pecs_error* error) {
  return pecs::capi::guard(error, [&] {
    const auto& prescription = pecs::capi::given(lens, "lens").prescription;
    const pecs::Json json = pecs::capi::options_from(options_json);
    const auto options = pecs::lens::info_options(pecs::JsonObject(json, "options"));
    pecs::lens::DrawOptions draw;
    draw.focus_m = options.focus_m;
    draw.stop_diameter_mm = pecs::lens::resolve_stop(prescription, options.stop);
    draw.film_half_diagonal_mm = 0.5 * std::hypot(options.film_width_mm, options.film_height_mm);
    if (!options.bands_nm.empty()) draw.bands_nm = options.bands_nm;
    return pecs::capi::hand_over(pecs::lens::draw_svg(prescription, draw));
  });
}

int64_t pecs_lens_directions(const pecs_lens* lens, const char* options_json, const double* pixels, int64_t count,
                             double* directions, int64_t capacity, pecs_error* error) {
  return pecs::capi::guard(error, [&] {
    pecs::capi::need_room(count, capacity);
    if (count) pecs::capi::given(pixels, "pixels"), pecs::capi::given(directions, "directions");
    const auto map = image_map(lens, options_json);
    tbb::parallel_for(int64_t{0}, count, [&](int64_t i) {
      const auto d = map->direction_from_pixel({pixels[2 * i], pixels[2 * i + 1]});
      const auto [x, y, z] = d.value_or(pecs::lens::Vec3{kNone, kNone, kNone});
      directions[3 * i] = x, directions[3 * i + 1] = y, directions[3 * i + 2] = z;
    });
    return count;
  });
}

int64_t pecs_lens_pixels(const pecs_lens* lens, const char* options_json, const double* directions, int64_t count,
                         double* pixels, int64_t capacity, pecs_error* error) {
  return pecs::capi::guard(error, [&] {
    pecs::capi::need_room(count, capacity);
    if (count) pecs::capi::given(pixels, "pixels"), pecs::capi::given(directions, "directions");
    const auto map = image_map(lens, options_json);
    tbb::parallel_for(int64_t{0}, count, [&](int64_t i) {
      const auto p = map->pixel_from_direction({directions[3 * i], directions[3 * i + 1], directions[3 * i + 2]});
      const auto [x, y] = p.value_or(pecs::lens::Pixel{kNone, kNone});
      pixels[2 * i] = x, pixels[2 * i + 1] = y;
    });
    return count;
  });
}

int pecs_lens_diffract(float* pixels, int width, int height, double pixel_pitch_mm, double lambda_nm,
                       double working_fnumber, pecs_error* error) {
  return pecs::capi::guard(error, [&] {
    if (!pixels || width < 1 || height < 1 || !(pixel_pitch_mm > 0) || !(lambda_nm > 0) || !(working_fnumber > 0))
      throw pecs::bad_input("picture", "", "no pixels, or a size, pitch, wavelength or f-number <= 0", "all above 0");
    pecs::lens::diffract({pixels, static_cast<std::size_t>(width) * height}, width, height, pixel_pitch_mm, lambda_nm,
                         working_fnumber);
    return 0;
  });
}

}  // extern "C"
