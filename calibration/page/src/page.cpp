#include "pecs/page/page.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "pecs/error.h"
#include "pecs/events/picture.h"
#include "pecs/text.h"
#include "pecs/ticks.h"

namespace pecs::page {

extern const std::string_view kPage, kReport;  // web/

namespace {

constexpr double kLeft = 64, kRight = 24, kTop = 34, kBottom = 44;

std::string number(double v) {
  for (const auto& [limit, unit, suffix] : {std::tuple{1e6, 1e6, "M"}, {1e4, 1e3, "k"}})
    if (std::abs(v) >= limit) return fmt::format("{:g}{}", v / unit, suffix);
  return fmt::format("{:.6g}", std::abs(v) < 1e-12 ? 0 : v);
}

}  // namespace

std::string html_of(const Json& node) {
  if (node.is_number_float()) return fmt::format("{:.6g}", node.get<double>());
  if (!node.is_array()) return html_escaped(node.is_string() ? node.get<std::string>() : text_of(node));
  const std::string tag = node.at(0);
  if (tag == "plot") return plot_svg(node.at(1));
  if (tag == "key") return html_escaped(words_of(node.at(1).get<std::string>()));
  std::string out = "<" + tag;
  const bool has_attributes = node.size() > 1 && (node[1].is_object() || node[1].is_null());
  if (has_attributes)
    for (const auto& [name, value] : node[1].items()) out += fmt::format(" {}=\"{}\"", name, html_of(value));
  out += ">";
  for (std::size_t i = has_attributes ? 2 : 1; i < node.size(); ++i) out += html_of(node[i]);
  return tag == "br" || tag == "img" || tag == "input" ? out : out + "</" + tag + ">";
}

std::string plot_svg(const Json& plot) {
  const bool small = plot.value("small", false);
  const double width = small ? 420 : 760, height = small ? 220 : 300;
  double x_low = 1e300, x_high = -1e300, y_low = 0, y_high = 0;
  for (const Json& s : plot.at("plot")) {
    for (const Json& x : s.at("x"))
      x_low = std::min(x_low, x.get<double>()), x_high = std::max(x_high, x.get<double>());
    for (const Json& y : s.at("y"))
      if (!y.is_null()) y_low = std::min(y_low, y.get<double>()), y_high = std::max(y_high, y.get<double>());
  }
  if (x_high <= x_low) x_high = x_low + 1;
  y_low *= 1.05, y_high = y_high > y_low ? y_high * 1.05 : 1;
  const auto px = [&](double x) { return kLeft + (x - x_low) / (x_high - x_low) * (width - kLeft - kRight); };
  const auto py = [&](double y) {
    return height - kBottom - (y - y_low) / (y_high - y_low) * (height - kTop - kBottom);
  };

  const std::string x_label = html_of(plot.at("x")), y_label = html_of(plot.at("y"));
  std::string svg = fmt::format("<svg class=\"plot\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{} over {}\">",
                                width, height, y_label, x_label);
  for (const double t : ticks(y_low, y_high, 5))
    svg += fmt::format(
        "<path class=\"grid\" d=\"M{:.1f} {:.1f}H{:.1f}\"/><text class=\"end\" x=\"{}\" y=\"{:.1f}\">{}</text>", kLeft,
        py(t), width - kRight, kLeft - 8, py(t) + 4, number(t));
  for (const double t : ticks(x_low, x_high, small ? 5 : 8))
    svg += fmt::format(
        "<path class=\"grid\" d=\"M{:.1f} {:.1f}v5\"/><text class=\"middle\" x=\"{:.1f}\" y=\"{}\">{}</text>", px(t),
        py(y_low), px(t), height - kBottom + 18, number(t));
  svg += fmt::format("<text class=\"middle label\" x=\"{}\" y=\"{}\">{}</text>", (kLeft + width - kRight) / 2,
                     height - 8, x_label);
  svg += fmt::format("<text class=\"middle label\" transform=\"translate(14 {}) rotate(-90)\">{}</text>",
                     (kTop + height - kBottom) / 2, y_label);

  double at = kLeft;
  for (const Json& s : plot.at("plot")) {
    const std::string style = html_of(s.at("style")), name = s.at("name");
    std::string path;
    bool is_begun = false;
    for (std::size_t i = 0; i < s.at("y").size(); ++i) {
      const Json& y = s.at("y").at(i);
      const double x = s.at("x").at(i);
      if (!y.is_null())
        path += s.value("stems", false) ? fmt::format("M{:.2f} {:.2f}V{:.2f}", px(x), py(0), py(y))
                                        : fmt::format("{}{:.2f} {:.2f}", is_begun ? 'L' : 'M', px(x), py(y));
      is_begun = !y.is_null();
    }
    svg += fmt::format("<path class=\"curve {}\" d=\"{}\"/>", style, path);
    svg += fmt::format("<path class=\"curve {}\" d=\"M{:.1f} 14h22\"/><text x=\"{:.1f}\" y=\"18\">{}</text>", style, at,
                       at + 28, html_escaped(name));
    at += 46 + 7.0 * static_cast<double>(name.size());
  }
  return svg + "</svg>";
}

std::string fill_template(std::string_view text, const std::map<std::string, std::string>& values) {
  std::string out;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t open = text.find("{{", at);
    if (open == text.npos) return out.append(text.substr(at));
    const std::size_t close = text.find("}}", open);
    out.append(text.substr(at, open - at));
    const auto value = values.find(std::string(text.substr(open + 2, close - open - 2)));
    if (close == text.npos || value == values.end())
      throw Error(ExitCode::internal, fmt::format("template: no value for '{}'", text.substr(open, 40)));
    out.append(value->second);
    at = close + 2;
  }
  return out;
}

std::string framed(const std::string& title, const std::string& content) {
  using events::kDark, events::kLight;
  return fill_template(kPage, {{"title", html_escaped(title)},
                               {"on_light", kLight.on.hex()},
                               {"off_light", kLight.off.hex()},
                               {"on_dark", kDark.on.hex()},
                               {"off_dark", kDark.off.hex()},
                               {"content", content}});
}

std::string page_of(const Json& page) {
  try {
    std::string body;
    for (const Json& node : page.at("body")) body += html_of(node) + "\n";
    return framed(page.at("title"), fill_template(kReport, {{"body", body}}));
  } catch (const Json::exception& e) {
    throw Error(ExitCode::usage, fmt::format("page: {}", e.what()));
  }
}

}  // namespace pecs::page
