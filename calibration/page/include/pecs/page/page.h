#pragma once
// Self-contained HTML pages in one style: those of reports, data sets, fits and events. Text is escaped here; no other
// file writes HTML.
#include <map>
#include <string>
#include <string_view>

#include "pecs/strict_json.h"

namespace pecs::page {

// A page {"title": "...", "body": [node, ...]}. A node is a text, a number or an element as in JsonML:
//   ["tag", {"attribute": text, ...}, node, ...]    the attributes may be left out
//   ["plot", {"plot": [{"name", "style", "x": [...], "y": [...], "stems": false}, ...], "x": label, "y": label,
//             "small": false}]                      style: classes such as "on sim"; null in y: a gap
//   ["key", "film_width_mm"]                         the key of a record in words, with its unit
// web/report.html has the classes, and the scripts of "player" and "filter".
std::string page_of(const Json& page);
std::string html_of(const Json& node);

// "film width (mm)" of "film_width_mm".
std::string words_of(std::string_view key);

template <class... Nodes>
Json element(const char* tag, const Json& attributes, const Nodes&... nodes) {
  Json out = Json::array({tag, attributes});
  (out.push_back(nodes), ...);
  return out;
}

// The SVG of a plot; a page gives it its colours.
std::string plot_svg(const Json& plot);

// The frame of every page, around content of web/.
std::string framed(const std::string& title, const std::string& content);

// Replaces every {{key}} of a template. Throws internal for a key without a value.
std::string fill_template(std::string_view text, const std::map<std::string, std::string>& values);

}  // namespace pecs::page
