#pragma once
// Reports about a lens for the program and the C interface, as JSON (keys: docs/reference/lens.md).
#include <optional>

#include "pecs/lens/image_map.h"
#include "pecs/lens/osl_camera.h"
#include "pecs/strict_json.h"

namespace pecs::lens {

// Stop by diameter or f-number, not both; neither: wide open. Throws bad_input.
struct StopChoice {
  std::optional<double> diameter_mm, fnumber;
};
double resolve_stop(const Prescription& lens, const StopChoice& choice);

struct InfoOptions {
  double lambda_nm = kLambdaD;
  std::optional<double> focus_m;
  StopChoice stop;
  double film_width_mm = 6.2208, film_height_mm = 3.4992;  // 1280 x 720 pixels of 4.86 um
  std::vector<double> bands_nm;                            // for colour along the field; empty: lambda_nm
  int field_rows = 5;
};
InfoOptions info_options(JsonObject options);  // rejects unknown keys
Json info(const Prescription& lens, const InfoOptions& options);

CameraOptions camera_options(const Prescription& lens, JsonObject options);
// The table of one wavelength: radii, ellipses, exact areas, E per radiance. Options: as info_options.
Json pupil_report(const Prescription& lens, const InfoOptions& options);

ImageSetting image_setting(const Prescription& lens, JsonObject options);

Json camera_report(const Prescription& lens, const Camera& camera);

}  // namespace pecs::lens
