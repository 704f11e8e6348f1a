#include "pecs/view/compare_plot.h"

#include <fmt/format.h>

#include "pecs/events/picture.h"
#include "pecs/page/page.h"

namespace pecs::view {

using namespace page;

namespace {

// The ON and OFF rate of one stream, up to its last event. `curve_us`: time that the bins cover.
void add_rates(Json& series, const metrics::StreamSummary& s, std::int64_t curve_us, const std::string& name,
               const std::string& style) {
  const double end_us = static_cast<double>(s.events) / s.rate_hz * 1e6;
  for (const auto& [hz, polarity, colour] : {std::tuple{&s.on_hz, " ON", "on "}, {&s.off_hz, " OFF", "off "}}) {
    std::vector<double> x, y = *hz;
    const double bin_us = static_cast<double>(curve_us) / static_cast<double>(hz->size());
    for (std::size_t i = 0; i < hz->size() && static_cast<double>(i) * bin_us < end_us; ++i)
      x.push_back((static_cast<double>(i) + 0.5) * bin_us * 1e-3);
    y.resize(x.size());
    series.push_back({{"name", name + polarity}, {"style", colour + style}, {"x", x}, {"y", y}});
  }
}

Json plot_of(Json rates) {
  return element("plot",
                 {{"plot", std::move(rates)}, {"x", "time from the first event (ms)"}, {"y", "events per second"}});
}

}  // namespace

Json rate_plot(const metrics::Comparison& c) {
  Json rates = Json::array();
  add_rates(rates, c.real, c.curve_us, "real", "real");
  add_rates(rates, c.sim, c.curve_us, "simulated", "sim");
  return plot_of(rates);
}

Json rate_plot(const events::Recording& recording) {
  Json rates = Json::array();
  add_rates(rates, metrics::summary_of(recording), recording.span_us, "events", "real");
  return plot_of(rates);
}

Json delay_plot(const metrics::DelayComparison& c) {
  Json series = Json::array();
  for (const auto& [d, name, style] : {std::tuple{&c.real, "real", "real"}, {&c.sim, "simulated", "sim"}})
    for (const std::size_t p : {1, 0}) {
      std::vector<double> x, y;
      for (std::size_t i = 0; i < d->histogram[p].size(); ++i) {
        x.push_back(c.first_deg + (static_cast<double>(i) + 0.5) * c.bin_deg);
        y.push_back(d->histogram[p][i] / c.bin_deg);
      }
      series.push_back({{"name", name + std::string(p ? " ON" : " OFF")},
                        {"style", (p ? "on " : "off ") + std::string(style)},
                        {"x", x},
                        {"y", y}});
    }
  return element("plot", {{"plot", series}, {"x", "degrees behind the edge"}, {"y", "events per edge and degree"}});
}

std::string compare_picture(const metrics::Comparison& c) {
  std::vector<std::string> plots = {plot_svg(rate_plot(c)[1])};
  if (c.delays) plots.push_back(plot_svg(delay_plot(*c.delays)[1]));
  constexpr int kWidth = 760, kHeight = 300;
  std::string svg = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\"><style>text {{ font: 12px sans-serif; fill: "
      "#626c78 }} .middle {{ text-anchor: middle }} .end {{ text-anchor: end }} .grid {{ stroke: #d5dae0; fill: none "
      "}} .curve {{ fill: none; stroke-width: 1.8 }} .on {{ stroke: {} }} .off {{ stroke: {} }} .sim {{ "
      "stroke-dasharray: 5 3 }}</style><rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>",
      kWidth, kHeight * plots.size(), events::kLight.on.hex(), events::kLight.off.hex());
  for (std::size_t i = 0; i < plots.size(); ++i)
    svg += fmt::format("<svg y=\"{}\" width=\"{}\" height=\"{}\">{}</svg>", i * kHeight, kWidth, kHeight, plots[i]);
  return svg + "</svg>\n";
}

}  // namespace pecs::view
