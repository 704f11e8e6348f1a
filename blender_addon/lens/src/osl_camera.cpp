#include "pecs/lens/osl_camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "osl_shader.h"
#include "pecs/error.h"
#include "pecs/lens/image_map.h"

namespace pecs::lens {
namespace {

double sum(const std::vector<double>& values) { return std::accumulate(values.begin(), values.end(), 0.0); }
double mean(const std::vector<double>& values) { return sum(values) / static_cast<double>(values.size()); }

// RMS distance on the film [mm] between the images of one scene point at two wavelengths, over the pupil of the film
// point (r, 0): rays leave it in the same direction and are compared on the focused plane (or in angle, at infinity).
double colour_shift_mm(const Tracer& a, const Tracer& b, const Focus& focus, const FirstOrder& f, double r_mm) {
  const ExactPupil pupil = exact_pupil(a, focus.film_z_mm, r_mm, 24);
  double sum = 0;
  int count = 0;
  for (std::size_t j = 0; j < pupil.edge_mm.size(); ++j) {
    for (const double part : {0.0, 0.4, 0.75, 0.95}) {
      const Vec3 edge = pupil.edge_point(j);
      const Vec3 aim{pupil.centre_x_mm + part * (edge.x - pupil.centre_x_mm), part * edge.y, a.rear_z_mm()};
      const Vec3 film{r_mm, 0, focus.film_z_mm};
      const Traced ta = a.to_scene({film, normalized(aim - film)}, Tracer::Clip::none);
      const Traced tb = b.to_scene({film, normalized(aim - film)}, Tracer::Clip::none);
      if (ta.fate != Fate::ok || tb.fate != Fate::ok) continue;
      // Both rays on a plane of the scene at the focused distance, scaled to the film (f / distance to the front
      // focus).
      const double depth = focus.distance_m ? *focus.distance_m * 1000.0 : 1e9;
      const double z = f.entrance_pupil_z_mm - depth;
      const Vec3 pa = ta.ray.at_z(z), pb = tb.ray.at_z(z);
      const double scale = f.efl_mm / std::abs(f.front_focus_z_mm - z);
      sum += scale * scale * ((pa.x - pb.x) * (pa.x - pb.x) + (pa.y - pb.y) * (pa.y - pb.y));
      ++count;
    }
  }
  return count ? std::sqrt(sum / count) : 0;
}

}  // namespace

Camera make_camera(const Prescription& lens, const CameraOptions& options) {
  Camera camera;
  camera.options = options;
  CameraOptions& o = camera.options;
  if (o.bands_nm.empty() || o.bands_nm.size() > 3)
    throw bad_input(lens.file, "bands_nm", fmt::format("{} bands", o.bands_nm.size()), "1 to 3");
  if (o.focus_bands_nm.empty()) o.focus_bands_nm = o.bands_nm;
  o.stop_diameter_mm = std::min(o.stop_diameter_mm, lens.stop_diameter_mm());
  const std::size_t bands = o.bands_nm.size();
  const bool has_shares = !o.band_shares.empty();
  if (has_shares && (o.band_shares.size() != bands || std::abs(sum(o.band_shares) - 1) > 1e-6))
    throw bad_input(lens.file, "band_shares", fmt::format("{} of sum {:.6g}", o.band_shares.size(), sum(o.band_shares)),
                    fmt::format("{} of sum 1", bands));
  if (o.share_spreads.size() != (has_shares ? bands - 1 : 0))
    throw bad_input(lens.file, "share_spreads", std::to_string(o.share_spreads.size()), "one per border between bands");
  // Largest distance of the film from the axis, and along it: at a corner.
  const FilmAxes axes = film_axes(o.film_tilt_x_deg, o.film_tilt_y_deg);
  double max_r = 0, max_dz = 0;
  for (const double u : {-0.5 * o.film_width_mm, 0.5 * o.film_width_mm})
    for (const double v : {-0.5 * o.film_height_mm, 0.5 * o.film_height_mm}) {
      const Vec3 corner = Vec3{o.film_shift_x_mm, o.film_shift_y_mm, 0} + u * axes.right + v * axes.up;
      max_r = std::max(max_r, std::hypot(corner.x, corner.y));
      max_dz = std::max(max_dz, std::abs(corner.z));
    }

  camera.focus = best_focus(lens, o.focus_bands_nm, o.focus_m, o.stop_diameter_mm);
  camera.first_order = first_order(lens, mean(o.focus_bands_nm), o.stop_diameter_mm);
  if (!std::isfinite(camera.first_order.entrance_pupil_z_mm))
    throw Error(ExitCode::unsupported, lens.file + ": the entrance pupil lies at infinity");

  // One wavelength for the whole pass if the bands' images coincide, otherwise one per sample. Light of a colour whose
  // shares differ from `band_shares` is traced in the wrong band, over the borders between.
  const double middle = mean(o.bands_nm);
  const Tracer at_mean(lens, middle, o.stop_diameter_mm);
  std::vector<Tracer> tracers;
  for (const double lambda : o.bands_nm) tracers.emplace_back(lens, lambda, o.stop_diameter_mm);
  camera.colour_shift_px = camera.mixed_shift_px = 0;
  for (const double part : {0.0, 0.5, 0.75, 1.0}) {
    const auto shift_px = [&](const Tracer& a, const Tracer& b) {
      return colour_shift_mm(a, b, camera.focus, camera.first_order, part * max_r) / o.pixel_pitch_mm;
    };
    for (const Tracer& tracer : tracers)
      camera.colour_shift_px = std::max(camera.colour_shift_px, shift_px(at_mean, tracer));
    double mixed_px = 0;
    for (std::size_t i = 0; i < o.share_spreads.size(); ++i)
      mixed_px += o.share_spreads[i] * shift_px(tracers[i], tracers[i + 1]);
    camera.mixed_shift_px = std::max(camera.mixed_shift_px, mixed_px);
  }
  const bool one = camera.colour_shift_px <= o.colour_tolerance_px;
  const bool mixed = has_shares && camera.mixed_shift_px <= o.colour_tolerance_px;
  camera.channel_mode = one ? ChannelMode::mean : mixed ? ChannelMode::mixed : ChannelMode::per_channel;
  if (one) tracers.assign(1, at_mean);
  if (!(camera.focus.film_z_mm - max_dz > lens.rear_z_mm()))
    throw bad_input(lens.file, "film_tilt", fmt::format("a film {:.4g} mm before its centre", max_dz),
                    fmt::format("less than {:.4g} mm, the last surface", camera.focus.film_z_mm - lens.rear_z_mm()));
  for (const Tracer& tracer : tracers)
    camera.tables.push_back(pupil_tables(tracer, camera.focus.film_z_mm, max_r, max_dz));
  for (std::size_t i = 0; i < o.bands_nm.size(); ++i) {
    const double e0 = one ? exact_pupil(Tracer(lens, o.bands_nm[i], o.stop_diameter_mm), camera.focus.film_z_mm, 0)
                                .irradiance_per_radiance
                          : camera.tables[i].e0;
    if (!(e0 > 0)) throw bad_input(lens.file, "surfaces", "no ray from the film's centre through the lens", "a lens");
    camera.e0_sr.push_back(e0);
  }
  const auto acceptance = [&](double part) {
    const PupilTables& t = camera.tables.front();
    return t.area_at(part * max_r) / t.ellipse_at(part * max_r).area_mm2();
  };
  camera.acceptance_centre = acceptance(0);
  camera.acceptance_half = acceptance(0.5);
  camera.acceptance_corner = acceptance(1);
  camera.shader_name = "pecs_lens";
  camera.osl = shader_text(lens, camera);
  return camera;
}

}  // namespace pecs::lens
