#include "pecs/lens/osl_camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "pecs/error.h"
#include "pecs/lens/image_map.h"
#include "pecs/version.h"

namespace pecs::lens {
namespace {

constexpr int kDraws = 4;           // the shader squares the chance of two
constexpr double kCarefulEfl = 60;  // mm
constexpr double kSteep = 0.5;      // curvature times the gap before

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

// One value per traced wavelength, as an expression.
std::string per_wavelength(const std::vector<double>& values) {
  std::string out = number(values.back());
  if (values.size() == 1) return out;
  for (std::size_t c = values.size() - 1; c-- > 0;) out = fmt::format("(c == {} ? {} : {})", c, number(values[c]), out);
  return out;
}

// One surface, met from the film's side. State: x y z relative to the vertex before, dx dy dz; Z towards the scene, so
// curvatures change sign. `break` leaves the draw as blocked. `careful`: against float32's rounding, for some 10 % more
// time.
std::string surface_text(const Prescription& lens, std::size_t i, double stop_diameter_mm,
                         const std::vector<std::vector<double>>& n_after, bool careful) {
  const Surface& s = lens.surfaces[i];
  const double gap = i + 1 < lens.surfaces.size() ? lens.surfaces[i + 1].z_mm - s.z_mm : 0.0;
  const double semi = i == lens.stop ? std::min(s.semi_diameter_mm, 0.5 * stop_diameter_mm) : s.semi_diameter_mm;
  const double c = -s.curvature, k = s.conic;
  bool index_changes = false;
  std::vector<double> ratio, square, one_less_square;  // of the indices, met from behind
  for (const auto& n : n_after) {
    ratio.push_back(n[i] / (i ? n[i - 1] : 1.0));
    square.push_back(ratio.back() * ratio.back());
    one_less_square.push_back(1 - square.back());
    index_changes = index_changes || ratio.back() != 1;
  }
  const std::string eta = per_wavelength(ratio);
  std::string out = fmt::format("    // surface {}\n", i);
  if (gap != 0) out += fmt::format("    z -= {};\n", number(gap));
  const bool plane = c == 0 && s.powers.empty();
  // A start far before a steep surface would cost digits: the vertex plane first.
  if (c == 0 || std::abs(c) * gap > kSteep) out += "    s = -z / dz; x += s * dx; y += s * dy; z = 0;\n";
  if (c != 0) {
    // With F = c (r^2 + (1+k) z^2) - 2 z, the surface F = 0: the root next to the vertex, q the unnormalised gradient
    // along the ray there.
    const std::string kz = k == 0 ? "z" : number(1 + k) + " * z";
    out += fmt::format("    h = dz - {} * (dx * x + dy * y + dz * {});\n", number(c), kz);
    out += fmt::format("    m = {} * (x * x + y * y + {} * z) - 2 * z;\n", number(c), kz);
    out += k == 0 ? fmt::format("    q = h * h - {} * m;\n", number(c))
                  : fmt::format("    q = h * h - {} * (1 + {} * dz * dz) * m;\n", number(c), number(k));
    out += "    if (q < 0) break;\n    q = sqrt(q);\n";
    out += "    s = m / (h + q); x += s * dx; y += s * dy; z += s * dz;\n";
  }
  if (!plane) {
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
  if (s.powers.empty() && k == 0 && !careful) {  // the gradient (-c x, -c y, 1 - c z) is unit, q its cosine
    if (std::abs(c) * semi > 0.7) out += fmt::format("    if ({} * z >= 1) break;\n", number(c));
    out += fmt::format("    g = {} + {} * (q * q);\n", per_wavelength(one_less_square), per_wavelength(square));
    if (std::ranges::any_of(ratio, [](double e) { return e > 1; })) out += "    if (g < 0) break;\n";
    out += fmt::format("    e = {}; g = sqrt(g) - e * q; h = {} * g;\n", eta, number(-c));
    out += "    dx = e * dx + h * x; dy = e * dy + h * y; dz = e * dz + h * z + g;\n";
    return out;
  }
  if (s.powers.empty() && k == 0) {
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
  out += fmt::format("    e = {};\n    g = 1 - e * e * (1 - q * q);\n    if (g < 0) break;\n    g = {};\n", eta,
                     careful ? per_wavelength(one_less_square) + " / (sqrt(g) + e * q)" : "sqrt(g) - e * q");
  out += "    dx = e * dx + g * nx; dy = e * dy + g * ny; dz = e * dz + g * nz;\n";
  if (careful) out += "    g = 1.5 - 0.5 * (dx * dx + dy * dy + dz * dz); dx *= g; dy *= g; dz *= g;\n";
  return out;
}

std::string shader_text(const Prescription& lens, const Camera& camera) {
  const CameraOptions& o = camera.options;
  const PupilTables& first = camera.tables.front();
  const bool per_channel = camera.channel_mode == ChannelMode::per_channel;
  std::vector<std::vector<double>> n_after;
  for (const PupilTables& t : camera.tables) n_after.push_back(lens.indices(t.layers.front().lambda_nm));

  // One layout for all channels and layers: a coarser table is read at the finer nodes, which changes nothing.
  std::size_t nodes = 0, dense = 0, layers = 0;
  for (const PupilTables& channel : camera.tables) {
    layers = std::max(layers, channel.layers.size());
    for (const PupilTable& t : channel.layers) {
      nodes = std::max(nodes, t.ellipses.size());
      dense = std::max(dense, t.areas_mm2.size());
    }
  }
  std::vector<Ellipse> ellipses;
  std::vector<double> areas;
  const auto step = [](std::size_t i, std::size_t count) {
    return static_cast<double>(i) / static_cast<double>(count - 1);
  };
  for (const PupilTables& t : camera.tables)
    for (std::size_t k = 0; k < layers; ++k) {
      const double dz = layers == 1 ? 0 : t.max_dz_mm * (2 * step(k, layers) - 1);
      for (std::size_t i = 0; i < nodes; ++i) ellipses.push_back(t.ellipse_at(t.max_r_mm * step(i, nodes), dz));
      for (std::size_t i = 0; i < dense; ++i) areas.push_back(t.area_at(t.max_r_mm * step(i, dense), dz) / t.e0);
    }
  const auto array = [](const char* name, const std::string& values, std::size_t size) {
    return fmt::format("  float table_{}[{}] = {{{}}};\n", name, size, values);
  };
  const std::string arrays = array("p", list(ellipses, [](const Ellipse& e) { return e.p_mm; }), ellipses.size()) +
                             array("a", list(ellipses, [](const Ellipse& e) { return e.a_mm; }), ellipses.size()) +
                             array("b", list(ellipses, [](const Ellipse& e) { return e.b_mm; }), ellipses.size()) +
                             "  // exact pupil area / E0\n" +
                             array("area", list(areas, [](double area) { return area; }), areas.size());

  // A direction's rounding is a distance on the film times the focal length.
  const bool careful = camera.first_order.efl_mm > kCarefulEfl;
  std::string surfaces;
  for (std::size_t i = lens.surfaces.size(); i-- > 0;)
    surfaces += surface_text(lens, i, o.stop_diameter_mm, n_after, careful);

  const double distance = camera.focus.film_z_mm - lens.rear_z_mm();
  std::vector<double> e0;  // pi a b / E0 from the area table's unit
  for (const PupilTables& t : camera.tables) e0.push_back(t.e0);
  const std::string throughput = !per_channel
                                     ? std::string("color(weight)")
                                     : fmt::format("{} * weight * color(c == 0, c == 1, c == 2)", o.bands_nm.size());
  const std::string pick =
      per_channel
          ? fmt::format("  // each sample traces one band\n  c = min(int({0} * xi0), {1});\n  xi0 = {0} * xi0 - c;\n",
                        o.bands_nm.size(), o.bands_nm.size() - 1)
          : "";
  // Value of a table at node i + t, between layers k and k + 1 of a tilted film.
  const auto value = [&](const char* name, std::size_t stride) {
    const std::string channel = per_channel ? fmt::format("{} * c + ", stride * layers) : "";
    const auto in_layer = [&](const std::string& layer) {
      return fmt::format("mix(table_{0}[{1}{2}i], table_{0}[{1}{2}i + 1], t)", name, channel, layer);
    };
    return layers == 1 ? in_layer("")
                       : fmt::format("mix({}, {}, l)", in_layer(fmt::format("{} * k + ", stride)),
                                     in_layer(fmt::format("{} * (k + 1) + ", stride)));
  };
  // The film point (fx, fy), its distance to the rear vertex and the cosine at the film.
  const FilmAxes axes = film_axes(o.film_tilt_x_deg, o.film_tilt_y_deg);
  std::string film, distance_at = number(distance), distance2_at = number(distance * distance), cosine = "dz";
  if (layers == 1) {
    film = fmt::format("  float fx = (0.5 - raster[0]) * {} + {}, fy = (0.5 - raster[1]) * {} + {};\n",
                       number(o.film_width_mm), number(o.film_shift_x_mm), number(o.film_height_mm),
                       number(o.film_shift_y_mm));
  } else {
    film = fmt::format(
        "  float across = (0.5 - raster[0]) * {}, along = (0.5 - raster[1]) * {};\n"
        "  float fx = {} + across * {} + along * {}, fy = {} + along * {}, fz = across * {} + along * {};\n"
        "  float far = {} + fz;\n"
        "  float l = clamp((fz + {}) * {}, 0, {});\n  int k = min(int(l), {});\n  l -= k;\n",
        number(o.film_width_mm), number(o.film_height_mm), number(o.film_shift_x_mm), number(axes.right.x),
        number(axes.up.x), number(o.film_shift_y_mm), number(axes.up.y), number(axes.right.z), number(axes.up.z),
        number(distance), number(first.max_dz_mm), number(static_cast<double>(layers - 1) / (2 * first.max_dz_mm)),
        layers - 1, layers - 2);
    distance_at = "far";
    distance2_at = "far * far";
    cosine =
        fmt::format("({} * dx + {} * dy + {} * dz)", number(axes.ahead.x), number(axes.ahead.y), number(-axes.ahead.z));
  }

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
{film}  float r = sqrt(fx * fx + fy * fy);
  float per_r = 1 / r, cosphi = r > 0 ? fx * per_r : 1, sinphi = fy * per_r;  // OSL: 1 / 0 = 0

  // the pupil there: interpolated ellipse (Eq. 2) and exact area
  float t = min(r * {per_node}, {last_node});
  int i = min(int(t), {nodes} - 2);
  t -= i;
  float centre = {p_at};
  float semi_a = {a_at};
  float semi_b = {b_at};
  t = min(r * {per_area}, {last_area});
  i = min(int(t), {areas} - 2);
  t -= i;
  float pupil = {area_at};
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
    // concentric map of the square onto the disc; sine and cosine of up to an eighth of a turn by their series
    float sx = 2 * draw0 - 1, sy = 2 * draw1 - 1;
    int wide = abs(sx) > abs(sy);
    float radius = wide ? sx : sy, angle = {quarter_pi} * ((wide ? sy : sx) / radius), square = angle * angle;
    float sine = radius * angle * (1 - square * (1.0 / 6 - square * (1.0 / 120 - square * (1.0 / 5040))));
    float cosine = radius * (1 - square * (1.0 / 2 - square * (1.0 / 24 - square * (1.0 / 720 - square * (1.0 / 40320)))));
    ex = centre + semi_a * (wide ? cosine : sine);
    ey = semi_b * (wide ? sine : cosine);

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
    weight = {cosine} * dz * dz * dz;

    do {{
{surfaces}
    ok = 1;
    }} while (0);
  }}
  if (ok && p > 0) {{
    // camera space: origin at the entrance pupil's centre
    position = {units_per_mm} * point(x, y, z + {pupil_z});
    direction = (1.5 - 0.5 * (dx * dx + dy * dy + dz * dz)) * vector(dx, dy, dz);  // unit but for rounding
    float blocked = (1 - p) * (1 - p);  // of two draws
    weight *= pupil / ({distance2} * (1 - blocked * blocked));
    throughput = {throughput};
  }}
}}
)",
      fmt::arg("version", kVersion), fmt::arg("name", lens.name), fmt::arg("sha256", lens.sha256),
      fmt::arg("bands", bands), fmt::arg("mode", per_channel ? "one per sample" : "traced at their mean"),
      fmt::arg("stop", number(camera.first_order.stop_diameter_mm)), fmt::arg("film_z", number(camera.focus.film_z_mm)),
      fmt::arg("focus", o.focus_m ? number(*o.focus_m) + " m" : "infinity"), fmt::arg("shader", camera.shader_name),
      fmt::arg("derivative", number(derivative)), fmt::arg("arrays", arrays), fmt::arg("pick", pick),
      fmt::arg("film", film), fmt::arg("nodes", nodes), fmt::arg("areas", dense),
      fmt::arg("per_node", number(static_cast<double>(nodes - 1) / first.max_r_mm)), fmt::arg("last_node", nodes - 1),
      fmt::arg("per_area", number(static_cast<double>(dense - 1) / first.max_r_mm)), fmt::arg("last_area", dense - 1),
      fmt::arg("p_at", value("p", nodes)), fmt::arg("a_at", value("a", nodes)), fmt::arg("b_at", value("b", nodes)),
      fmt::arg("area_at", value("area", dense)), fmt::arg("e0", per_wavelength(e0)),
      fmt::arg("pi", number(std::numbers::pi)), fmt::arg("quarter_pi", number(std::numbers::pi / 4)),
      fmt::arg("draws", kDraws), fmt::arg("distance", distance_at), fmt::arg("distance2", distance2_at),
      fmt::arg("cosine", cosine), fmt::arg("surfaces", surfaces),
      fmt::arg("pupil_z", number(camera.first_order.entrance_pupil_z_mm)), fmt::arg("throughput", throughput),
      fmt::arg("units_per_mm", number(0.001 / o.unit_m)));
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
  // How far the film reaches from the axis, and along it: at a corner.
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
