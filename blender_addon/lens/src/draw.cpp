#include "pecs/lens/draw.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "pecs/lens/first_order.h"

namespace pecs::lens {
namespace {

constexpr double kWidth = 960, kMargin = 24;

// One colour per field (Okabe-Ito, told apart by the colour-blind), dashes per wavelength.
constexpr const char* kFieldColours[] = {"#0072B2", "#009E73", "#D55E00", "#CC79A7", "#E69F00", "#56B4E9"};
constexpr const char* kDashes[] = {"1 2", "none", "5 2", "7 2 1 2"};

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) out += c == '&' ? "&amp;" : c == '<' ? "&lt;" : c == '>' ? "&gt;" : std::string(1, c);
  return out;
}

}  // namespace

std::string draw_svg(const Prescription& lens, const DrawOptions& o) {
  const Focus focus = best_focus(lens, o.bands_nm, o.focus_m, o.stop_diameter_mm);
  double half_height = o.film_half_diagonal_mm;
  for (const Surface& s : lens.surfaces) half_height = std::max(half_height, s.semi_diameter_mm);
  half_height *= 1.08;
  const double length = focus.film_z_mm, ahead = 0.15 * length, behind = 0.03 * length;
  const double scale = (kWidth - 2 * kMargin) / (length + ahead + behind);
  const double height = 2 * half_height * scale + 2 * kMargin;
  const auto sx = [&](double z) { return kMargin + (z + ahead) * scale; };
  const auto sy = [&](double y) { return 0.5 * height - y * scale; };

  std::string svg = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {:.0f} {:.0f}\" font-family=\"sans-serif\" "
      "font-size=\"12\">\n"
      "<title>{}</title>\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
      "<line x1=\"{:.1f}\" x2=\"{:.1f}\" y1=\"{:.1f}\" y2=\"{:.1f}\" stroke=\"#999\" stroke-dasharray=\"8 3 2 3\"/>\n",
      kWidth, height + 18, escaped(lens.name), kMargin, kWidth - kMargin, 0.5 * height, 0.5 * height);

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
  for (const double side : {1.0, -1.0})
    svg += fmt::format(
        "<line x1=\"{0:.2f}\" x2=\"{0:.2f}\" y1=\"{1:.2f}\" y2=\"{2:.2f}\" stroke=\"black\" stroke-width=\"2.5\"/>\n",
        sx(stop.z_mm + stop.sag_mm(stop_r)), sy(side * stop_r),
        sy(side * std::max(stop_r, std::min(half_height * 0.97, stop.semi_diameter_mm * 1.25))));
  svg += fmt::format(
      "<line x1=\"{0:.2f}\" x2=\"{0:.2f}\" y1=\"{1:.2f}\" y2=\"{2:.2f}\" stroke=\"black\" stroke-width=\"3\"/>\n",
      sx(focus.film_z_mm), sy(o.film_half_diagonal_mm), sy(-o.film_half_diagonal_mm));

  for (std::size_t w = 0; w < o.bands_nm.size(); ++w) {
    const Tracer tracer(lens, o.bands_nm[w], o.stop_diameter_mm);
    for (std::size_t k = 0; k < o.fields.size(); ++k) {
      for (const auto& line :
           ray_fan(tracer, focus.film_z_mm, o.fields[k] * o.film_half_diagonal_mm, o.rays_per_fan, ahead)) {
        std::string points;
        for (const Vec3& p : line)
          if (std::abs(p.x) <= 1.5 * half_height) points += fmt::format("{:.2f},{:.2f} ", sx(p.z), sy(p.x));
        svg += fmt::format(
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"0.7\" stroke-dasharray=\"{}\"/>\n",
            points, kFieldColours[k % 6], kDashes[w % 4]);
      }
    }
  }
  std::string fields, bands;
  for (const double f : o.fields)
    fields += fmt::format("{}{:.3g} mm", fields.empty() ? "" : ", ", f * o.film_half_diagonal_mm);
  for (const double b : o.bands_nm) bands += fmt::format("{}{:.4g}", bands.empty() ? "" : ", ", b);
  svg += fmt::format(
      "<text x=\"{:.0f}\" y=\"{:.0f}\">{} — film points {}; {} nm; stop {:.3g} mm; focus {}</text>\n</svg>\n", kMargin,
      height + 8, escaped(lens.name), fields, bands, 2 * stop_r,
      o.focus_m ? fmt::format("{:g} m", *o.focus_m) : "infinity");
  return svg;
}

}  // namespace pecs::lens
