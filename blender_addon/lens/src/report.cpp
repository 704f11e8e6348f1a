#include "pecs/lens/report.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "pecs/error.h"
#include "pecs/lens/diffraction.h"
#include "pecs/lens/field.h"

namespace pecs::lens {
namespace {

Json finite(double x) { return std::isfinite(x) ? Json(x) : Json(nullptr); }

StopChoice read_stop(JsonObject& options) {
  return {options.maybe_number("stop_diameter_mm", {1e-6, 1e4}), options.maybe_number("fnumber", {0.1, 1e4})};
}

// Reads the members that CameraOptions and ImageSetting share.
template <class Options>
void read_film(const Prescription& lens, JsonObject& options, Options& o) {
  if (options.has("focus_bands_nm")) o.focus_bands_nm = options.numbers("focus_bands_nm", {100, 20000});
  o.focus_m = options.maybe_number("focus_m", {1e-4, 1e9});
  o.stop_diameter_mm = resolve_stop(lens, read_stop(options));
  o.film_shift_x_mm = options.number_or("film_shift_x_mm", 0, {-1e3, 1e3});
  o.film_shift_y_mm = options.number_or("film_shift_y_mm", 0, {-1e3, 1e3});
  o.film_tilt_x_deg = options.number_or("film_tilt_x_deg", 0, {-45, 45});
  o.film_tilt_y_deg = options.number_or("film_tilt_y_deg", 0, {-45, 45});
  o.pixel_pitch_mm = options.number_or("pixel_pitch_mm", o.pixel_pitch_mm, {1e-5, 10});
}

}  // namespace

double resolve_stop(const Prescription& lens, const StopChoice& choice) {
  if (choice.diameter_mm && choice.fnumber)
    throw bad_input(lens.file, "stop", "both a diameter and an f-number", "one of them");
  if (choice.fnumber) return stop_diameter_for_fnumber(lens, *choice.fnumber);
  if (!choice.diameter_mm) return lens.stop_diameter_mm();
  if (*choice.diameter_mm > lens.stop_diameter_mm() * (1 + 1e-9))
    throw bad_input(lens.file, "stop", std::to_string(*choice.diameter_mm) + " mm",
                    "at most " + std::to_string(lens.stop_diameter_mm()) + " mm, wide open");
  return *choice.diameter_mm;
}

InfoOptions info_options(JsonObject options) {
  InfoOptions o;
  o.lambda_nm = options.number_or("lambda_nm", o.lambda_nm, {100, 20000});
  o.focus_m = options.maybe_number("focus_m", {1e-4, 1e9});
  o.stop = read_stop(options);
  o.film_width_mm = options.number_or("film_width_mm", o.film_width_mm, {1e-3, 1e3});
  o.film_height_mm = options.number_or("film_height_mm", o.film_height_mm, {1e-3, 1e3});
  if (options.has("bands_nm")) o.bands_nm = options.numbers("bands_nm", {100, 20000});
  o.field_rows = static_cast<int>(options.integer_or("field_rows", o.field_rows, 2, 1000));
  options.done();
  return o;
}

Json info(const Prescription& lens, const InfoOptions& o) {
  const double stop = resolve_stop(lens, o.stop);
  const FirstOrder f = first_order(lens, o.lambda_nm, stop);
  const double bands[] = {o.lambda_nm};
  const Focus focus = best_focus(lens, bands, o.focus_m, stop);
  const Tracer tracer(lens, o.lambda_nm, stop);
  const double half_w = 0.5 * o.film_width_mm, half_h = 0.5 * o.film_height_mm, corner = std::hypot(half_w, half_h);
  const auto full_angle = [&](double r) {
    const auto half = field_angle_deg(tracer, lens.stop, focus.film_z_mm, r);
    return half ? Json(2 * *half) : Json(nullptr);
  };
  const ExactPupil axis = exact_pupil(tracer, focus.film_z_mm, 0);

  Json glasses = Json::array();
  for (std::size_t i = 0; i < lens.surfaces.size(); ++i) {
    const Glass& g = lens.surfaces[i].after;
    if (!g.is_air())
      glasses.push_back({{"surface", i}, {"name", g.name()}, {"dispersion", g.source()}, {"n", g.n(o.lambda_nm)}});
  }
  const std::vector<double> field_bands = o.bands_nm.empty() ? std::vector<double>{o.lambda_nm} : o.bands_nm;
  Json field = Json::array();
  for (const FieldRow& row : field_rows(lens, field_bands, o.lambda_nm, stop, focus, corner, o.field_rows))
    field.push_back({{"r_mm", row.r_mm},
                     {"angle_deg", finite(row.angle_deg)},
                     {"relative_illumination", row.relative_illumination},
                     {"distortion_percent", finite(row.distortion_percent)},
                     {"lateral_colour_um", row.lateral_colour_um},
                     {"rms_spot_um", row.rms_spot_um}});
  return {{"name", lens.name},
          {"file", lens.file},
          {"sha256", lens.sha256},
          {"surfaces", lens.surfaces.size()},
          {"lambda_nm", o.lambda_nm},
          {"efl_mm", f.efl_mm},
          {"bfl_mm", f.bfl_mm},
          {"fnumber", f.fnumber},
          // 1 / (2 sin) of the real axial cone behind the lens: E0 = pi sin^2 for a uniform scene.
          {"working_fnumber", 0.5 / std::sqrt(axis.irradiance_per_radiance / std::numbers::pi)},
          {"stop_diameter_mm", f.stop_diameter_mm},
          {"entrance_pupil_z_mm", finite(f.entrance_pupil_z_mm)},
          {"entrance_pupil_diameter_mm", finite(f.entrance_pupil_diameter_mm)},
          {"exit_pupil_z_mm", finite(f.exit_pupil_z_mm)},
          {"exit_pupil_diameter_mm", finite(f.exit_pupil_diameter_mm)},
          {"front_focus_z_mm", f.front_focus_z_mm},
          {"rear_focus_z_mm", f.rear_focus_z_mm},
          {"front_principal_z_mm", f.front_principal_z_mm},
          {"rear_principal_z_mm", f.rear_principal_z_mm},
          {"rear_vertex_z_mm", lens.rear_z_mm()},
          {"focus_m", or_null(o.focus_m)},
          {"film_z_mm", focus.film_z_mm},
          {"rms_spot_um", 1e3 * focus.rms_spot_mm},
          {"e0_sr", axis.irradiance_per_radiance},
          {"film_width_mm", o.film_width_mm},
          {"film_height_mm", o.film_height_mm},
          {"hfov_deg", full_angle(half_w)},
          {"vfov_deg", full_angle(half_h)},
          {"dfov_deg", full_angle(corner)},
          {"glasses", glasses},
          {"notes", lens.notes},
          {"field_bands_nm", field_bands},
          {"field", field}};
}

Json pupil_report(const Prescription& lens, const InfoOptions& o) {
  const double stop = resolve_stop(lens, o.stop);
  const double bands[] = {o.lambda_nm};
  const Focus focus = best_focus(lens, bands, o.focus_m, stop);
  const PupilTable table = pupil_table(Tracer(lens, o.lambda_nm, stop), focus.film_z_mm,
                                       0.5 * std::hypot(o.film_width_mm, o.film_height_mm));
  Json rows = Json::array();
  const std::size_t count = table.areas_mm2.size();
  for (std::size_t i = 0; i < count; ++i) {
    const double r = table.max_r_mm * static_cast<double>(i) / static_cast<double>(count - 1);
    const Ellipse e = table.ellipse_at(r);
    rows.push_back({{"r_mm", r},
                    {"p_mm", e.p_mm},
                    {"a_mm", e.a_mm},
                    {"b_mm", e.b_mm},
                    {"area_mm2", table.areas_mm2[i]},
                    {"acceptance", table.areas_mm2[i] / e.area_mm2()},
                    {"irradiance_per_radiance_sr", table.irradiance[i]},
                    {"relative_illumination", table.irradiance[i] / table.e0()}});
  }
  return {{"name", lens.name},
          {"file", lens.file},
          {"lambda_nm", o.lambda_nm},
          {"focus_m", or_null(o.focus_m)},
          {"stop_diameter_mm", stop},
          {"film_z_mm", focus.film_z_mm},
          {"plane_z_mm", lens.rear_z_mm()},
          {"missed_fraction", table.missed_fraction},
          {"e0_sr", table.e0()},
          {"pupil", rows}};
}

CameraOptions camera_options(const Prescription& lens, JsonObject options) {
  CameraOptions o;
  o.bands_nm = options.numbers("bands_nm", {100, 20000});
  read_film(lens, options, o);
  o.film_width_mm = options.number_or("film_width_mm", o.film_width_mm, {1e-3, 1e3});
  o.film_height_mm = options.number_or("film_height_mm", o.film_height_mm, {1e-3, 1e3});
  o.colour_tolerance_px = options.number_or("colour_tolerance_px", o.colour_tolerance_px, {0, 1e6});
  if (options.has("band_shares")) o.band_shares = options.numbers("band_shares", {0, 1});
  if (options.has("share_spreads")) o.share_spreads = options.numbers("share_spreads", {0, 1});
  o.unit_m = options.number_or("unit_m", o.unit_m, {1e-9, 1e9});
  options.done();
  return o;
}

ImageSetting image_setting(const Prescription& lens, JsonObject options) {
  ImageSetting s;
  s.width_px = static_cast<int>(options.integer("width", 1, 65536));
  s.height_px = static_cast<int>(options.integer("height", 1, 65536));
  s.lambda_nm = options.number_or("lambda_nm", s.lambda_nm, {100, 20000});
  read_film(lens, options, s);
  options.done();
  return s;
}

Json camera_report(const Prescription& lens, const Camera& camera) {
  static constexpr const char* kModes[] = {"mean", "mixed", "per_channel"};
  Json missed = Json::array();
  for (const PupilTables& table : camera.tables) missed.push_back(table.missed_fraction);
  // The renderer applies diffraction per band, if the Airy radius exceeds half a pixel.
  std::vector<double> working, airy;
  for (std::size_t i = 0; i < camera.e0_sr.size(); ++i) {
    working.push_back(0.5 / std::sqrt(camera.e0_sr[i] / std::numbers::pi));
    airy.push_back(airy_radius_mm(camera.options.bands_nm[i], working.back()) / camera.options.pixel_pitch_mm);
  }
  const bool diffraction = *std::max_element(airy.begin(), airy.end()) > 0.5;
  return {{"osl", camera.osl},
          {"shader_name", camera.shader_name},
          {"bands_nm", camera.options.bands_nm},
          {"e0", camera.e0_sr},
          {"film_z_mm", camera.focus.film_z_mm},
          {"film_width_mm", camera.options.film_width_mm},
          {"film_height_mm", camera.options.film_height_mm},
          {"film_shift_x_mm", camera.options.film_shift_x_mm},
          {"film_shift_y_mm", camera.options.film_shift_y_mm},
          {"film_tilt_x_deg", camera.options.film_tilt_x_deg},
          {"film_tilt_y_deg", camera.options.film_tilt_y_deg},
          {"focus_m", or_null(camera.options.focus_m)},
          {"rms_spot_um", 1e3 * camera.focus.rms_spot_mm},
          {"stop_diameter_mm", camera.first_order.stop_diameter_mm},
          {"fnumber", camera.first_order.fnumber},
          {"efl_mm", camera.first_order.efl_mm},
          {"entrance_pupil_z_mm", camera.first_order.entrance_pupil_z_mm},
          {"channel_mode", kModes[static_cast<std::size_t>(camera.channel_mode)]},
          {"colour_shift_px", camera.colour_shift_px},
          {"mixed_shift_px",
           or_null(camera.options.band_shares.empty() ? std::nullopt : std::optional(camera.mixed_shift_px))},
          {"acceptance", {camera.acceptance_centre, camera.acceptance_half, camera.acceptance_corner}},
          {"missed_fraction", missed},
          {"working_fnumber", working},
          {"airy_radius_px", airy},
          {"diffraction", diffraction},
          {"pixel_pitch_mm", camera.options.pixel_pitch_mm},
          {"lens_name", lens.name},
          {"file", lens.file},
          {"sha256", lens.sha256}};
}

}  // namespace pecs::lens
