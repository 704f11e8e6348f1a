#include "pecs/lens/osl_camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "pecs/error.h"
#include "pecs/version.h"

namespace pecs::lens {
namespace {

constexpr int kDraws = 4;

double mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return sum / static_cast<double>(values.size());
}

// RMS distance on the film [mm] between the images of one scene point at two wavelengths, over the pupil of the film
// point (r, 0): rays leave it alike and are compared where they meet the focused plane (or in angle, at infinity).
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

std::string number(double x) { return fmt::format("{:.9g}", x); }

template <class T, class F>
std::string list(const std::vector<T>& values, const F& f) {
  std::string out;
  for (const T& v : values) out += (out.empty() ? "" : ", ") + number(f(v));
  return out;
}

// The index ratio of surface i met from behind, per traced wavelength, as an expression.
std::string eta_text(const std::vector<std::vector<double>>& n_after, std::size_t i) {
  std::vector<double> eta;
  for (const auto& n : n_after) eta.push_back(n[i] / (i ? n[i - 1] : 1.0));
  if (eta.size() == 1) return number(eta[0]);
  std::string out = number(eta.back());
  for (std::size_t c = eta.size() - 1; c-- > 0;) out = fmt::format("(c == {} ? {} : {})", c, number(eta[c]), out);
  return out;
}

// One surface, met from the film's side. State: x y z relative to the vertex before, dx dy dz; Z towards the scene, so
// curvatures change sign. `break` leaves the draw as blocked.
std::string surface_text(const Prescription& lens, std::size_t i, double stop_diameter_mm, const std::string& eta,
                         bool index_changes) {
  const Surface& s = lens.surfaces[i];
  const double gap = i + 1 < lens.surfaces.size() ? lens.surfaces[i + 1].z_mm - s.z_mm : 0.0;
  const double semi = i == lens.stop ? std::min(s.semi_diameter_mm, 0.5 * stop_diameter_mm) : s.semi_diameter_mm;
  const double c = -s.curvature, k = s.conic;
  std::string out = fmt::format("    // surface {}\n", i);
  if (gap != 0) out += fmt::format("    z -= {};\n", number(gap));
  out += "    s = -z / dz; x += s * dx; y += s * dy; z = 0;\n";
  const bool plane = c == 0 && s.powers.empty();
  if (!plane) {
    // Root of c (r^2 + (1+k) z^2) - 2 z = 0 nearest to the vertex.
    if (c != 0) {
      out += fmt::format("    h = dz - {} * (dx * x + dy * y);\n", number(c));
      out += k == 0 ? fmt::format("    q = h * h - {} * (x * x + y * y);\n", number(c * c))
                    : fmt::format("    q = h * h - {} * (1 + {} * dz * dz) * (x * x + y * y);\n", number(c * c),
                                  number(k));
      out += "    if (q < 0) break;\n    q = sqrt(q);\n";
      out += fmt::format("    s = {} * (x * x + y * y) / (h + q);\n", number(c));
      out += "    x += s * dx; y += s * dy; z = s * dz;\n";
    }
    if (!s.powers.empty()) {
      // Newton; the sag in the reversed frame is the negative of the prescription's.
      std::string poly = "0", slope = "0";
      for (std::size_t p = s.powers.size(); p-- > 2;) {
        poly = fmt::format("({} * g + {})", poly, number(-s.powers[p]));
        slope = fmt::format("({} * g + {})", slope, number(-s.powers[p] * static_cast<double>(p)));
      }
      out += "    e = 0;\n    for (int j = 0; j < 4; ++j) {\n      r2 = x * x + y * y; g = sqrt(r2);\n";
      out += fmt::format("      e = 1 - {} * r2;\n      if (e <= 0) break;\n      e = sqrt(e);\n",
                         number((1 + k) * c * c));
      out += fmt::format("      m = {} / e + {};\n", number(c), slope);
      out +=
          fmt::format("      s = (z - {} * r2 / (1 + e) - r2 * {}) / (dz - m * (x * dx + y * dy));\n", number(c), poly);
      out += "      x -= s * dx; y -= s * dy; z -= s * dz;\n    }\n    if (e <= 0) break;\n";
    }
  }
  out += fmt::format("    if (x * x + y * y > {}) break;\n", number(semi * semi));
  if (!index_changes) return out;
  if (plane) {
    out += fmt::format("    e = {};\n    g = 1 - e * e * (1 - dz * dz);\n    if (g < 0) break;\n", eta);
    out += "    dx *= e; dy *= e; dz = sqrt(g);\n";
    return out;
  }
  if (s.powers.empty() && k == 0) {  // the gradient is unit, q its cosine with the ray
    out += fmt::format("    nx = {} * x; ny = {} * y; nz = 1 - {} * z;\n", number(-c), number(-c), number(c));
    if (std::abs(c) * semi > 0.7) out += "    if (nz <= 0) break;\n";
  } else if (s.powers.empty()) {
    out += fmt::format("    nx = {} * x; ny = {} * y; nz = 1 - {} * z;\n", number(-c), number(-c), number((1 + k) * c));
    out +=
        "    if (nz <= 0) break;\n    m = 1 / sqrt(nx * nx + ny * ny + nz * nz);\n    nx *= m; ny *= m; nz *= m; q *= "
        "m;\n";
  } else {
    out += "    nz = 1 / sqrt(1 + m * m * (x * x + y * y)); nx = -m * x * nz; ny = -m * y * nz;\n";
    out += "    q = dx * nx + dy * ny + dz * nz;\n    if (q <= 0) break;\n";
  }
  out += fmt::format("    e = {};\n    g = 1 - e * e * (1 - q * q);\n    if (g < 0) break;\n    g = sqrt(g) - e * q;\n",
                     eta);
  out += "    dx = e * dx + g * nx; dy = e * dy + g * ny; dz = e * dz + g * nz;\n";
  return out;
}

std::string shader_text(const Prescription& lens, const Camera& camera) {
  const CameraOptions& o = camera.options;
  const PupilTable& first = camera.tables.front();
  const bool per_channel = camera.channel_mode == ChannelMode::per_channel;
  const std::size_t traced = camera.tables.size();
  std::vector<std::vector<double>> n_after;
  for (const PupilTable& table : camera.tables) n_after.push_back(lens.indices(table.lambda_nm));

  std::string arrays;
  std::size_t nodes = 0, dense = 0;
  for (const PupilTable& t : camera.tables) {
    nodes = std::max(nodes, t.ellipses.size());
    dense = std::max(dense, t.areas_mm2.size());
  }
  // One table layout for all channels: a coarser table is read at the finer nodes, which changes nothing.
  std::vector<Ellipse> ellipses;
  std::vector<double> areas;
  for (const PupilTable& t : camera.tables) {
    for (std::size_t i = 0; i < nodes; ++i)
      ellipses.push_back(t.ellipse_at(t.max_r_mm * static_cast<double>(i) / static_cast<double>(nodes - 1)));
    for (std::size_t i = 0; i < dense; ++i)
      areas.push_back(t.area_at(t.max_r_mm * static_cast<double>(i) / static_cast<double>(dense - 1)) / t.e0());
  }
  arrays += fmt::format("  float table_p[{}] = {{{}}};\n", ellipses.size(),
                        list(ellipses, [](const Ellipse& e) { return e.p_mm; }));
  arrays += fmt::format("  float table_a[{}] = {{{}}};\n", ellipses.size(),
                        list(ellipses, [](const Ellipse& e) { return e.a_mm; }));
  arrays += fmt::format("  float table_b[{}] = {{{}}};\n", ellipses.size(),
                        list(ellipses, [](const Ellipse& e) { return e.b_mm; }));
  arrays += fmt::format("  // exact pupil area / E0\n  float table_area[{}] = {{{}}};\n", areas.size(),
                        list(areas, [](double a) { return a; }));

  std::string surfaces;
  for (std::size_t i = lens.surfaces.size(); i-- > 0;) {
    bool changes = false;
    for (const auto& n : n_after) changes = changes || n[i] != (i ? n[i - 1] : 1.0);
    surfaces += surface_text(lens, i, o.stop_diameter_mm, eta_text(n_after, i), changes);
  }

  const double distance = camera.focus.film_z_mm - lens.rear_z_mm();
  const std::string e0_at = [&] {  // pi a b / E0 from the area table's unit
    std::string out = number(camera.tables.back().e0());
    for (std::size_t c = traced - 1; c-- > 0;)
      out = fmt::format("(c == {} ? {} : {})", c, number(camera.tables[c].e0()), out);
    return out;
  }();
  const std::string throughput = !per_channel
                                     ? std::string("color(weight)")
                                     : fmt::format("{} * weight * color(c == 0, c == 1, c == 2)", o.bands_nm.size());
  const std::string pick =
      per_channel
          ? fmt::format("  // each sample traces one band\n  c = min(int({0} * xi0), {1});\n  xi0 = {0} * xi0 - c;\n",
                        o.bands_nm.size(), o.bands_nm.size() - 1)
          : "";
  const auto at = [&](const char* table, std::size_t stride, const char* index) {
    return per_channel ? fmt::format("{}[{} * c + {}]", table, stride, index) : fmt::format("{}[{}]", table, index);
  };
  const auto at_next = [&](const char* table, std::size_t stride, const char* index) {
    return per_channel ? fmt::format("{}[{} * c + {} + 1]", table, stride, index)
                       : fmt::format("{}[{} + 1]", table, index);
  };

  std::string bands;
  for (const double b : o.bands_nm) bands += (bands.empty() ? "" : ", ") + number(b);
  const double derivative = o.pixel_pitch_mm / camera.first_order.efl_mm;
  return fmt::format(
      R"(// Generated by PECS {version}. Lens: {name} (sha256 {sha256:.16}).
// Bands {bands} nm, {mode}; stop {stop} mm; film at {film_z} mm; focus {focus}.
#include "stdcycles.h"

shader {shader}(output point position = 0, output vector direction = 0, output color throughput = 0,
    output point dPdx = 0, output point dPdy = 0,
    output vector dDdx = vector({derivative}, 0, 0), output vector dDdy = vector(0, {derivative}, 0))
{{
{arrays}
  vector xi = camera_shader_random_sample();
  float xi0 = xi[0], xi1 = xi[1];
  int c = 0;
{pick}
  // film point; the picture on the film is upside down
  point raster = camera_shader_raster_position();
  float fx = (0.5 - raster[0]) * {width} + {shift_x}, fy = (0.5 - raster[1]) * {height} + {shift_y};
  float r = sqrt(fx * fx + fy * fy);
  float cosphi = r > 0 ? fx / r : 1, sinphi = r > 0 ? fy / r : 0;

  // the pupil there: interpolated ellipse (Eq. 2) and exact area
  float t = min(r * {per_node}, {last_node});
  int i = min(int(t), {nodes} - 2);
  t -= i;
  float centre = mix({p0}, {p1}, t);
  float semi_a = mix({a0}, {a1}, t);
  float semi_b = mix({b0}, {b1}, t);
  t = min(r * {per_area}, {last_area});
  i = min(int(t), {areas} - 2);
  t -= i;
  float pupil = mix({area0}, {area1}, t);
  // chance of one draw to get through
  float p = min(1, pupil * {e0} / ({pi} * semi_a * semi_b));

  int ok = 0;
  float weight = 0, x = 0, y = 0, z = 0, dx = 0, dy = 0, dz = 0;
  float ex = 0, ey = 0, s, h, q, e, g, m, r2, nx, ny, nz;
  for (int draw = 0; draw < {draws} && !ok; ++draw) {{
    float draw0 = xi0, draw1 = xi1;
    if (draw > 0) {{
      draw0 = noise("hash", point(xi0, xi1, draw));
      draw1 = noise("hash", point(xi0, xi1, draw + 0.5));
    }}
    // concentric map of the square onto the disc
    float sx = 2 * draw0 - 1, sy = 2 * draw1 - 1, radius = 0, angle = 0;
    if (abs(sx) > abs(sy)) {{
      radius = sx;
      angle = {quarter_pi} * sy / sx;
    }} else if (sy != 0) {{
      radius = sy;
      angle = {half_pi} - {quarter_pi} * sx / sy;
    }}
    ex = centre + semi_a * radius * cos(angle);
    ey = semi_b * radius * sin(angle);

    // ray from the film through the direction plane, the plane of the rear vertex
    x = ex * cosphi - ey * sinphi;
    y = ex * sinphi + ey * cosphi;
    z = 0;
    dx = x - fx;
    dy = y - fy;
    dz = 1 / sqrt(dx * dx + dy * dy + {distance2});
    dx *= dz;
    dy *= dz;
    dz *= {distance};
    weight = dz * dz * dz * dz;

    do {{
{surfaces}
    ok = 1;
    }} while (0);
  }}
  if (ok && p > 0) {{
    // camera space: origin at the entrance pupil's centre
    position = 0.001 * point(x, y, z + {pupil_z});
    direction = normalize(vector(dx, dy, dz));
    weight *= pupil * {over_distance2} / (1 - pow(1 - p, {draws}));
    throughput = {throughput};
  }}
}}
)",
      fmt::arg("version", kVersion), fmt::arg("name", lens.name), fmt::arg("sha256", lens.sha256),
      fmt::arg("bands", bands), fmt::arg("mode", per_channel ? "one per sample" : "traced at their mean"),
      fmt::arg("stop", number(camera.first_order.stop_diameter_mm)), fmt::arg("film_z", number(camera.focus.film_z_mm)),
      fmt::arg("focus", o.focus_m ? number(*o.focus_m) + " m" : "infinity"), fmt::arg("shader", camera.shader_name),
      fmt::arg("derivative", number(derivative)), fmt::arg("arrays", arrays), fmt::arg("pick", pick),
      fmt::arg("width", number(o.film_width_mm)), fmt::arg("height", number(o.film_height_mm)),
      fmt::arg("shift_x", number(o.film_shift_x_mm)), fmt::arg("shift_y", number(o.film_shift_y_mm)),
      fmt::arg("nodes", nodes), fmt::arg("areas", dense),
      fmt::arg("per_node", number(static_cast<double>(nodes - 1) / first.max_r_mm)), fmt::arg("last_node", nodes - 1),
      fmt::arg("per_area", number(static_cast<double>(dense - 1) / first.max_r_mm)), fmt::arg("last_area", dense - 1),
      fmt::arg("p0", at("table_p", nodes, "i")), fmt::arg("p1", at_next("table_p", nodes, "i")),
      fmt::arg("a0", at("table_a", nodes, "i")), fmt::arg("a1", at_next("table_a", nodes, "i")),
      fmt::arg("b0", at("table_b", nodes, "i")), fmt::arg("b1", at_next("table_b", nodes, "i")),
      fmt::arg("area0", at("table_area", dense, "i")), fmt::arg("area1", at_next("table_area", dense, "i")),
      fmt::arg("e0", e0_at), fmt::arg("pi", number(std::numbers::pi)),
      fmt::arg("half_pi", number(std::numbers::pi / 2)), fmt::arg("quarter_pi", number(std::numbers::pi / 4)),
      fmt::arg("draws", kDraws), fmt::arg("distance", number(distance)),
      fmt::arg("distance2", number(distance * distance)),
      fmt::arg("over_distance2", number(1.0 / (distance * distance))), fmt::arg("surfaces", surfaces),
      fmt::arg("pupil_z", number(camera.first_order.entrance_pupil_z_mm)), fmt::arg("throughput", throughput));
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
  const double max_r = std::hypot(0.5 * o.film_width_mm + std::abs(o.film_shift_x_mm),
                                  0.5 * o.film_height_mm + std::abs(o.film_shift_y_mm));

  camera.focus = best_focus(lens, o.focus_bands_nm, o.focus_m, o.stop_diameter_mm);
  camera.first_order = first_order(lens, mean(o.focus_bands_nm), o.stop_diameter_mm);
  if (!std::isfinite(camera.first_order.entrance_pupil_z_mm))
    throw Error(ExitCode::unsupported, lens.file + ": the entrance pupil lies at infinity");

  // One wavelength for the whole pass where the bands' pictures coincide, one per sample else.
  const double middle = mean(o.bands_nm);
  const Tracer at_mean(lens, middle, o.stop_diameter_mm);
  double shift_mm = 0;
  std::vector<Tracer> tracers;
  for (const double lambda : o.bands_nm) {
    tracers.emplace_back(lens, lambda, o.stop_diameter_mm);
    for (const double part : {0.0, 0.5, 0.75, 1.0})
      shift_mm =
          std::max(shift_mm, colour_shift_mm(at_mean, tracers.back(), camera.focus, camera.first_order, part * max_r));
  }
  camera.colour_shift_px = shift_mm / o.pixel_pitch_mm;
  const bool one = camera.colour_shift_px <= o.colour_tolerance_px;
  camera.channel_mode = one ? ChannelMode::mean : ChannelMode::per_channel;
  if (one) tracers.assign(1, at_mean);
  for (const Tracer& tracer : tracers) camera.tables.push_back(pupil_table(tracer, camera.focus.film_z_mm, max_r));
  for (std::size_t i = 0; i < o.bands_nm.size(); ++i) {
    const double e0 = one ? exact_pupil(Tracer(lens, o.bands_nm[i], o.stop_diameter_mm), camera.focus.film_z_mm, 0)
                                .irradiance_per_radiance
                          : camera.tables[i].e0();
    if (!(e0 > 0)) throw bad_input(lens.file, "surfaces", "no ray from the film's centre through the lens", "a lens");
    camera.e0_sr.push_back(e0);
  }
  const auto acceptance = [&](double part) {
    const PupilTable& t = camera.tables.front();
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
