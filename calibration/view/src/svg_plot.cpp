#include "svg_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "pecs/text.h"

namespace pecs::view {
namespace {

constexpr double kWidth = 760, kHeight = 300, kLeft = 64, kRight = 24, kTop = 34, kBottom = 44;

std::vector<double> ticks(double low, double high, int wanted) {
  const double raw = std::max(high - low, 1e-12) / wanted, power = std::pow(10, std::floor(std::log10(raw)));
  double step = 10 * power;
  for (const double m : {5.0, 2.0, 1.0})
    if (m * power >= raw) step = m * power;
  std::vector<double> out;
  for (double t = std::ceil(low / step - 1e-9) * step; t <= high + 1e-9 * step; t += step) out.push_back(t);
  return out;
}

std::string number(double v) {
  for (const auto& [limit, unit, suffix] : {std::tuple{1e6, 1e6, "M"}, {1e4, 1e3, "k"}})
    if (std::abs(v) >= limit) return fmt::format("{:g}{}", v / unit, suffix);
  return fmt::format("{:.6g}", std::abs(v) < 1e-12 ? 0 : v);
}

}  // namespace

std::string line_plot(const std::vector<Series>& series, const std::string& x_label, const std::string& y_label) {
  double x_low = 1e300, x_high = -1e300, y_high = 0;
  for (const Series& s : series) {
    for (const double x : s.x) x_low = std::min(x_low, x), x_high = std::max(x_high, x);
    for (const double y : s.y) y_high = std::max(y_high, y);
  }
  if (x_high <= x_low) x_high = x_low + 1;
  y_high = y_high > 0 ? y_high * 1.05 : 1;
  const auto px = [&](double x) { return kLeft + (x - x_low) / (x_high - x_low) * (kWidth - kLeft - kRight); };
  const auto py = [&](double y) { return kHeight - kBottom - y / y_high * (kHeight - kTop - kBottom); };

  std::string svg = fmt::format("<svg class=\"plot\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{} over {}\">",
                                kWidth, kHeight, html_escaped(y_label), html_escaped(x_label));
  for (const double t : ticks(0, y_high, 5))
    svg += fmt::format(
        "<path class=\"grid\" d=\"M{:.1f} {:.1f}H{:.1f}\"/><text class=\"end\" x=\"{}\" y=\"{:.1f}\">{}</text>", kLeft,
        py(t), kWidth - kRight, kLeft - 8, py(t) + 4, number(t));
  for (const double t : ticks(x_low, x_high, 8))
    svg += fmt::format(
        "<path class=\"grid\" d=\"M{:.1f} {:.1f}v5\"/><text class=\"middle\" x=\"{:.1f}\" y=\"{}\">{}</text>", px(t),
        py(0), px(t), kHeight - kBottom + 18, number(t));
  svg += fmt::format("<text class=\"middle label\" x=\"{}\" y=\"{}\">{}</text>", (kLeft + kWidth - kRight) / 2,
                     kHeight - 8, html_escaped(x_label));
  svg += fmt::format("<text class=\"middle label\" transform=\"translate(14 {}) rotate(-90)\">{}</text>",
                     (kTop + kHeight - kBottom) / 2, html_escaped(y_label));

  double at = kLeft;
  for (const Series& s : series) {
    std::string path;
    for (std::size_t i = 0; i < s.x.size(); ++i)
      path += s.stems ? fmt::format("M{:.2f} {:.2f}V{:.2f}", px(s.x[i]), py(0), py(s.y[i]))
                      : fmt::format("{}{:.2f} {:.2f}", i ? 'L' : 'M', px(s.x[i]), py(s.y[i]));
    svg += fmt::format("<path class=\"curve {}\" d=\"{}\"/>", s.style, path);
    svg += fmt::format("<path class=\"curve {}\" d=\"M{:.1f} 14h22\"/><text x=\"{:.1f}\" y=\"18\">{}</text>", s.style,
                       at, at + 28, html_escaped(s.name));
    at += 46 + 7.0 * static_cast<double>(s.name.size());
  }
  return svg + "</svg>";
}

}  // namespace pecs::view
