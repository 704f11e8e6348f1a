#include "pecs/lens/draw.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "pecs/lens/diffraction.h"
#include "pecs/lens/first_order.h"
#include "pecs/text.h"
#include "pecs/ticks.h"

namespace pecs::lens {
namespace {

constexpr double kWidth = 960, kMargin = 24, kSpotSize = 170;

// One colour per field or per wavelength (Okabe-Ito, distinguishable by colour-blind readers); in the section, dashes
// per wavelength.
constexpr const char* kColours[] = {"#0072B2", "#009E73", "#D55E00", "#CC79A7", "#E69F00", "#56B4E9"};
constexpr const char* kDashes[] = {"1 2", "none", "5 2", "7 2 1 2"};

std::string line(double x1, double y1, double x2, double y2, const std::string& style) {
  return fmt::format("<line x1=\"{:.2f}\" y1=\"{:.2f}\" x2=\"{:.2f}\" y2=\"{:.2f}\" {}/>\n", x1, y1, x2, y2, style);
}

// anchor: start, middle or end of the text is at (x, y).
std::string label(double x, double y, const std::string& text, const char* anchor = "start", const char* style = "") {
  return fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\" {}>{}</text>\n", x, y, anchor, style,
                     html_escaped(text));
}
constexpr const char *kSmall = "font-size=\"10\"", *kBold = "font-weight=\"bold\"";

struct Section {
  std::string svg;  // without the frame
  double height;
};

Section draw_section(const Prescription& lens, const DrawOptions& o) {
  const Focus focus = best_focus(lens, o.bands_nm, o.focus_m, o.stop_diameter_mm);
  double half_height = o.film_half_diagonal_mm;
  for (const Surface& s : lens.surfaces) half_height = std::max(half_height, s.semi_diameter_mm);
  half_height *= 1.08;
  const double length = focus.film_z_mm, ahead = 0.15 * length, behind = 0.03 * length;
  const double scale = (kWidth - 2 * kMargin) / (length + ahead + behind);
  const auto sx = [&](double z) { return kMargin + (z + ahead) * scale; };
  const auto sy = [&](double y) { return kMargin + (half_height - y) * scale; };

  std::string svg = line(kMargin, sy(0), kWidth - kMargin, sy(0), "stroke=\"#999\" stroke-dasharray=\"8 3 2 3\"");

  // Glass between two surfaces; both profiles run to their own housing radius, joined by the rim.
  const auto profile = [&](const Surface& s, bool upwards) {
    std::string out;
    constexpr int kSteps = 48;
    for (int i = -kSteps; i <= kSteps; ++i) {
      const double y = (upwards ? 1 : -1) * s.semi_diameter_mm * i / kSteps;
      out += fmt::format("{:.2f},{:.2f} ", sx(s.z_mm + s.sag_mm(std::abs(y))), sy(y));
    }
    return out;
  };
  for (std::size_t i = 0; i + 1 < lens.surfaces.size(); ++i)
    if (!lens.surfaces[i].after.is_air())
      svg += fmt::format("<polygon points=\"{}{}\" fill=\"#dbe9f6\" stroke=\"#456\" stroke-width=\"0.8\"/>\n",
                         profile(lens.surfaces[i], true), profile(lens.surfaces[i + 1], false));

  const Surface& stop = lens.surfaces[lens.stop];
  const double stop_r = std::min(stop.semi_diameter_mm, 0.5 * o.stop_diameter_mm);
  const double stop_x = sx(stop.z_mm + stop.sag_mm(stop_r)), film_x = sx(focus.film_z_mm);
  const double blade_r = std::max(stop_r, std::min(half_height * 0.97, stop.semi_diameter_mm * 1.25));
  for (const double side : {1.0, -1.0})
    svg += line(stop_x, sy(side * stop_r), stop_x, sy(side * blade_r), "stroke=\"black\" stroke-width=\"2.5\"");
  svg += line(film_x, sy(o.film_half_diagonal_mm), film_x, sy(-o.film_half_diagonal_mm),
              "stroke=\"black\" stroke-width=\"3\"");

  double lowest = -half_height;  // rays come from below
  for (std::size_t w = 0; w < o.bands_nm.size(); ++w) {
    const Tracer tracer(lens, o.bands_nm[w], o.stop_diameter_mm);
    for (std::size_t k = 0; k < o.fields.size(); ++k) {
      for (const auto& line :
           ray_fan(tracer, lens.stop, focus.film_z_mm, o.fields[k] * o.film_half_diagonal_mm, o.rays_per_fan, ahead)) {
        std::string points;
        for (const Vec3& p : line)
          if (std::abs(p.x) <= 1.5 * half_height) {
            points += fmt::format("{:.2f},{:.2f} ", sx(p.z), sy(p.x));
            lowest = std::min(lowest, p.x);
          }
        svg += fmt::format(
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"0.7\" stroke-dasharray=\"{}\"/>\n",
            points, kColours[k % 6], kDashes[w % 4]);
      }
    }
  }
  std::string fields, bands;
  for (const double f : o.fields)
    fields += fmt::format("{}{:.3g} mm", fields.empty() ? "" : ", ", f * o.film_half_diagonal_mm);
  for (const double b : o.bands_nm) bands += fmt::format("{}{:.4g}", bands.empty() ? "" : ", ", b);
  const double height = sy(lowest) + kMargin;
  svg += label(kMargin, height + 8,
               fmt::format("{} — film points {}; {} nm; stop {:.3g} mm; focus {}", lens.name, fields, bands, 2 * stop_r,
                           o.focus_m ? fmt::format("{:g} m", *o.focus_m) : "infinity"));
  return {svg, height + 18};
}

std::string framed(const std::string& title, double height, const std::string& body, double width = kWidth) {
  return fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {:.0f} {:.0f}\" font-family=\"sans-serif\" "
      "font-size=\"12\">\n"
      "<title>{}</title>\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n{}</svg>\n",
      width, height, html_escaped(title), body);
}

struct Curve {
  std::vector<double> x, y;
  std::string colour, dash, label;
  double width = 1.3;
};

struct Box {
  double left, top, width, height;
};

// A small plot; the curves widen the y range where they exceed it.
std::string plot(const Box& box, const std::string& title, const std::string& x_name, const std::vector<Curve>& curves,
                 double y_low, double y_high) {
  double x_high = 0;
  for (const Curve& c : curves)
    for (std::size_t i = 0; i < c.x.size(); ++i) {
      if (!std::isfinite(c.y[i])) continue;
      x_high = std::max(x_high, c.x[i]);
      y_low = std::min(y_low, c.y[i]);
      y_high = std::max(y_high, c.y[i]);
    }
  if (!(x_high > 0)) x_high = 1;
  if (!(y_high > y_low)) y_high = y_low + 1;
  const std::vector<double> x_ticks = ticks(0, x_high, 5);
  std::vector<double> y_ticks = ticks(y_low, y_high, 5);
  const double step = y_ticks[1] - y_ticks[0];
  if (y_ticks.front() > y_low + 1e-9 * step) y_ticks.insert(y_ticks.begin(), y_low = y_ticks.front() - step);
  if (y_ticks.back() < y_high - 1e-9 * step) y_ticks.push_back(y_high = y_ticks.back() + step);
  const double in_left = box.left + 46, in_top = box.top + 20, in_width = box.width - 60, in_height = box.height - 56;
  const auto sx = [&](double x) { return in_left + x / x_high * in_width; };
  const auto sy = [&](double y) { return in_top + (y_high - y) / (y_high - y_low) * in_height; };
  std::string svg = label(in_left, box.top + 12, title, "start", kBold);
  for (const double y : y_ticks) {
    svg += line(in_left, sy(y), in_left + in_width, sy(y), "stroke=\"#ddd\"");
    svg += label(in_left - 4, sy(y) + 4, fmt::format("{:.4g}", std::abs(y) < 1e-9 * step ? 0.0 : y), "end", kSmall);
  }
  for (const double x : x_ticks)
    svg += label(sx(x), in_top + in_height + 12, fmt::format("{:.4g}", x), "middle", kSmall);
  svg += label(in_left + 0.5 * in_width, in_top + in_height + 25, x_name, "middle", kSmall);
  std::string names;
  std::size_t longest = 0;
  for (const Curve& c : curves) longest = std::max(longest, c.label.size());
  const double names_width = 6.0 * static_cast<double>(longest);
  double name_y = 11, high = 0, low = 0;  // points of curves behind the names, at the top and at the bottom
  for (const Curve& c : curves)
    if (!c.label.empty()) {
      const std::string style = fmt::format("{} fill=\"{}\"", kSmall, c.colour);
      names += label(in_left + in_width - 3, in_top + name_y, c.label, "end", style.c_str());
      name_y += 12;
    }
  for (const Curve& c : curves) {
    std::string points;
    for (std::size_t i = 0; i < c.x.size(); ++i)
      if (std::isfinite(c.y[i])) {
        points += fmt::format("{:.1f},{:.1f} ", sx(c.x[i]), sy(c.y[i]));
        const bool is_behind = sx(c.x[i]) > in_left + in_width - names_width;
        high += is_behind && sy(c.y[i]) < in_top + name_y;
        low += is_behind && sy(c.y[i]) > in_top + in_height - name_y;
      }
    svg += fmt::format(
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\" stroke-dasharray=\"{}\"/>\n", points,
        c.colour, c.width, c.dash);
  }
  if (names.empty()) return svg;
  return svg + fmt::format(
                   "<g transform=\"translate(0 {:.1f})\"><rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" "
                   "height=\"{:.1f}\" fill=\"#fff\" fill-opacity=\"0.85\"/>\n{}</g>\n",
                   high > low ? in_height - name_y + 7 : 0, in_left + in_width - names_width, in_top + 1, names_width,
                   name_y - 10, names);
}

// Data of a chart: the spots of all fields and bands through the focused lens.
struct Chart {
  const Prescription& lens;
  const DrawOptions& o;
  Focus focus = best_focus(lens, o.bands_nm, o.focus_m, o.stop_diameter_mm);
  double reference_nm = o.bands_nm[o.bands_nm.size() / 2];
  Tracer reference{lens, reference_nm, o.stop_diameter_mm};
  double pupil_z = first_order(lens, reference_nm, o.stop_diameter_mm).entrance_pupil_z_mm;
  std::vector<std::vector<std::vector<Vec3>>> spots;  // [field][band]
  double most_mm = 1e-4;                              // from a field's point to its farthest hit

  Chart(const Prescription& l, const DrawOptions& options);
  std::string spot_diagrams(double top) const;
  std::vector<Curve> mtf(double working_fnumber) const;
};

Chart::Chart(const Prescription& l, const DrawOptions& options) : lens(l), o(options), spots(options.fields.size()) {
  for (std::size_t k = 0; k < o.fields.size(); ++k) {
    const double r = o.fields[k] * o.film_half_diagonal_mm;
    const auto object = object_point(reference, lens.stop, focus, pupil_z, r);
    for (const double lambda : o.bands_nm) {
      spots[k].push_back(object
                             ? spot(Tracer(lens, lambda, o.stop_diameter_mm), reference, *object, focus, pupil_z, r, 22)
                             : std::vector<Vec3>{});
      for (const Vec3& p : spots[k].back()) most_mm = std::max({most_mm, std::abs(p.x - r), std::abs(p.y)});
    }
  }
}

// All fields on one scale.
std::string Chart::spot_diagrams(double top) const {
  const double cell = (kWidth - 2 * kMargin) / static_cast<double>(o.fields.size());
  const double spot_scale = 0.46 * kSpotSize / most_mm, bar_mm = ticks(0, most_mm, 3).back();
  std::string svg;
  for (std::size_t k = 0; k < o.fields.size(); ++k) {
    const double r = o.fields[k] * o.film_half_diagonal_mm, cx = kMargin + (static_cast<double>(k) + 0.5) * cell,
                 cy = top + 0.5 * kSpotSize + 16;
    svg += label(cx, top + 10, fmt::format("Spots at {:.3g} mm", r), "middle", kBold);
    for (std::size_t w = 0; w < spots[k].size(); ++w) {
      std::string path;
      for (const Vec3& p : spots[k][w])
        path += fmt::format("M{:.1f} {:.1f}h.9", cx + p.y * spot_scale, cy - (p.x - r) * spot_scale);
      svg += fmt::format("<path d=\"{}\" stroke=\"{}\" stroke-width=\"0.9\"/>\n", path, kColours[w % 6]);
    }
    const double scale_y = cy + 0.5 * kSpotSize + 4, scale_x = cx - bar_mm * spot_scale;
    svg += line(scale_x, scale_y, cx, scale_y, "stroke=\"black\"");
    svg += label(0.5 * (scale_x + cx), scale_y + 11, fmt::format("{:.4g} um", 1e3 * bar_mm), "middle", kSmall);
  }
  return svg;
}

std::vector<Curve> Chart::mtf(double working) const {
  std::vector<Curve> curves;
  const auto band = spots.front().size() / 2;
  Curve limit{{}, {}, "#999", "2 2", "diffraction"};
  for (int i = 0; i <= 40; ++i) {
    limit.x.push_back(2.5 * i);
    limit.y.push_back(diffraction_mtf(2.5 * i, reference_nm, working));
  }
  for (std::size_t k = 0; k < o.fields.size(); ++k) {
    const double r = o.fields[k] * o.film_half_diagonal_mm;
    const char* shade = kColours[k % 6];
    Curve t_geometric{limit.x, {}, shade, "none", "", 0.5}, s_geometric{limit.x, {}, shade, "5 2", "", 0.5};
    for (const double f : limit.x) {
      const Mtf m = geometric_mtf(spots[k][band], f);
      t_geometric.y.push_back(m.tangential);
      s_geometric.y.push_back(m.sagittal);
    }
    curves.push_back(std::move(t_geometric));
    curves.push_back(std::move(s_geometric));
    const auto object = object_point(reference, lens.stop, focus, pupil_z, r);
    if (!object) continue;
    const MtfCurve wave = wavefront_mtf(lens, reference, *object, focus, r, limit.x.back());
    curves.push_back(
        {wave.cycles_per_mm, wave.tangential, shade, "none", fmt::format("{:.3g} mm (solid T, dashed S)", r)});
    curves.push_back({wave.cycles_per_mm, wave.sagittal, shade, "5 2", ""});
  }
  curves.push_back(limit);
  return curves;
}

}  // namespace

std::string draw_svg(const Prescription& lens, const DrawOptions& o) {
  const Section section = draw_section(lens, o);
  return framed(lens.name, section.height, section.svg);
}

std::string chart_svg(const Prescription& lens, const DrawOptions& o) {
  const Section section = draw_section(lens, o);
  const Chart chart(lens, o);
  const double top = section.height + 8, third = (kWidth - kMargin) / 3, tall = 210;
  std::string svg = section.svg + chart.spot_diagrams(top);
  const double first_row = top + kSpotSize + 44, second_row = first_row + tall + 6;

  const auto rows =
      field_rows(lens, o.bands_nm, chart.reference_nm, o.stop_diameter_mm, chart.focus, o.film_half_diagonal_mm, 21);
  std::vector<double> r_mm, illumination, distortion;
  for (const FieldRow& row : rows) {
    r_mm.push_back(row.r_mm);
    illumination.push_back(row.relative_illumination);
    distortion.push_back(row.distortion_percent);
  }
  std::vector<Curve> colour, spot_curves;
  for (std::size_t w = 0; w < o.bands_nm.size(); ++w) {
    Curve lateral{r_mm, {}, kColours[w % 6], "none", fmt::format("{:.4g} nm", o.bands_nm[w])}, size = lateral;
    for (const FieldRow& row : rows) {
      lateral.y.push_back(row.lateral_colour_um[w]);
      size.y.push_back(row.rms_spot_um[w]);
    }
    colour.push_back(lateral);
    spot_curves.push_back(size);
  }
  svg += plot({8, first_row, third, tall}, "Relative illumination", "film radius, mm",
              {{r_mm, illumination, "#0072B2", "none", ""}}, 0, 1);
  svg += plot({8 + third, first_row, third, tall}, "Distortion, %", "film radius, mm",
              {{r_mm, distortion, "#0072B2", "none", ""}}, -0.1, 0.1);
  svg += plot({8 + 2 * third, first_row, third, tall}, "Lateral colour, um", "film radius, mm", colour, -0.5, 0.5);
  svg += plot({8, second_row, third, tall}, "RMS spot, um", "film radius, mm", spot_curves, 0, 1);

  const double e0 = exact_pupil(chart.reference, chart.focus.film_z_mm, 0).irradiance_per_radiance;
  const double working = 0.5 / std::sqrt(e0 / std::numbers::pi);
  svg += plot({8 + third, second_row, 2 * third, tall + 40},
              fmt::format("MTF at {:.4g} nm with diffraction (F/{:.3g}); thin: geometric", chart.reference_nm, working),
              "cycles per mm (pixels of 4.86 um: Nyquist 103)", chart.mtf(working), 0, 1);
  return framed(lens.name, second_row + tall + 50, svg);
}

std::string draw_pupils_svg(const Prescription& lens, double lambda_nm, double stop_diameter_mm, double film_z_mm,
                            double max_r_mm) {
  constexpr int kShown = 5;
  constexpr double kCell = 190;
  const Tracer tracer(lens, lambda_nm, stop_diameter_mm);
  const PupilTable table = pupil_table(tracer, film_z_mm, max_r_mm);
  double most = 0;
  for (const Ellipse& e : table.ellipses) most = std::max({most, e.a_mm, e.b_mm});
  const double scale = 0.45 * kCell / most;
  std::string svg;
  for (int i = 0; i < kShown; ++i) {
    const double r = max_r_mm * i / (kShown - 1.0), cx = (i + 0.5) * kCell, cy = 0.5 * kCell;
    const Ellipse e = table.ellipse_at(r);
    const ExactPupil pupil = exact_pupil(tracer, film_z_mm, r);
    std::string points;
    const int n = static_cast<int>(pupil.edge_mm.size());
    for (int j = -n; j < n; ++j) {
      const Vec3 p = pupil.edge_point(j < 0 ? n - 1 - (j + n) : j);
      points += fmt::format("{:.2f},{:.2f} ", cx + (p.x - e.p_mm) * scale, cy - (j < 0 ? -p.y : p.y) * scale);
    }
    svg += fmt::format("<polygon points=\"{}\" fill=\"#56B4E9\" stroke=\"#0072B2\" stroke-width=\"0.8\"/>\n", points);
    svg += fmt::format(
        "<ellipse cx=\"{:.2f}\" cy=\"{:.2f}\" rx=\"{:.2f}\" ry=\"{:.2f}\" fill=\"none\" stroke=\"#D55E00\"/>\n", cx, cy,
        e.a_mm * scale, e.b_mm * scale);
    svg +=
        label(cx, kCell + 14, fmt::format("r {:.3g} mm, {:.1f} %", r, 100 * table.area_at(r) / e.area_mm2()), "middle");
  }
  svg += label(8, kCell + 34,
               fmt::format("{} — exact pupil (blue), covering ellipse, part of it that passes; {:.4g} nm", lens.name,
                           lambda_nm));
  return framed(lens.name, kCell + 44, svg, kShown * kCell);
}

}  // namespace pecs::lens
