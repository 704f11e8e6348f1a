#include "pecs/view/report_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <opencv2/imgproc.hpp>

#include "pack.h"
#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/input/media.h"
#include "pecs/metrics/time_shift.h"
#include "pecs/sensor/chip.h"
#include "pecs/sensor/photocurrent.h"
#include "pecs/sensor/stack.h"
#include "pecs/strict_json.h"
#include "pecs/text.h"
#include "pecs/version.h"
#include "pecs/view/compare_plot.h"
#include "pecs/view/event_pictures.h"
#include "svg_plot.h"
#include "web.h"

namespace pecs::view {
namespace {

constexpr std::size_t kPlayerEvents = 200'000;  // per stream, in the page
constexpr double kLeastCorrelation = 0.2;       // a lower correlation is not significant

struct EventFile {
  std::filesystem::path path;
  events::Recording recording;
  Json run;  // <path>.run.json, or null
  std::string run_file() const { return run_record_path(path).string(); }
};

EventFile read_events(const std::filesystem::path& path) {
  EventFile file{path, events::recording_of(events::read_all(path), path.string(), 0, INT64_MAX), nullptr};
  if (std::filesystem::exists(file.run_file())) file.run = parse_json_file(file.run_file());
  return file;
}

// A copy with the file's own times.
events::Stream stream_of(const events::Recording& recording) {
  events::Stream stream{{recording.width, recording.height, ""}, recording.events};
  for (events::Event& e : stream.events) e.t_us += recording.first_us;
  return stream;
}

struct Stack {
  sensor::StackReader reader;
  Json json;
  std::string sha256;
};

std::string row(const std::string& name, const std::string& value, const std::string& note = "") {
  return fmt::format("<tr><td>{}</td><td>{}</td><td class=\"note\">{}</td></tr>", html_escaped(name),
                     html_escaped(value), html_escaped(note));
}

std::string missing(const std::string& what) { return fmt::format("<p class=\"missing\">{}</p>", html_escaped(what)); }

std::string text_of(const Json& value) {
  if (value.is_string()) return value.get<std::string>();
  if (value.is_number_float()) return fmt::format("{:.6g}", value.get<double>());
  if (value.is_array()) {
    std::string list;
    for (const auto& item : value) list += (list.empty() ? "" : ", ") + text_of(item);
    return list;
  }
  return value.is_null() ? "none" : pecs::text_of(value);
}

// The value of a key, whatever the types are; null without one.
Json member(const Json& json, const char* key) {
  const auto found = json.is_object() ? json.find(key) : json.end();
  return found == json.end() ? Json() : *found;
}
std::string text_in(const Json& json, const char* key) {
  const Json value = member(json, key);
  return value.is_null() ? "" : text_of(value);
}

std::string png_source(const cv::Mat& image) { return "data:image/png;base64," + base64(input::media().png_of(image)); }

// Table rows for an object of stack.json, whose values are {"value": …, "unit": …} or plain.
std::string rows_of(const Json& object) {
  std::string rows;
  if (!object.is_object()) return {};
  for (const auto& [key, value] : object.items()) {
    if (key.starts_with('_')) continue;
    if (value.is_object() && value.contains("value"))
      rows += row(key, text_of(value["value"]) + " " + text_in(value, "unit"), text_in(value, "about"));
    else if (!value.is_object() && !value.is_null())
      rows += row(key, text_of(value));
  }
  return rows;
}

// Photocurrent of the first frame, with display gamma; without a chip, for a constant quantum efficiency.
cv::Mat brightness(const sensor::StackReader& stack, const std::optional<sensor::Chip>& chip) {
  const sensor::StackInfo& info = stack.info();
  sensor::Chip flat;
  flat.relative_qe = {{1, 1e6}, {1, 1}};
  cv::Mat_<float> light(info.height, info.width);
  sensor::PhotocurrentReader(stack, sensor::amperes_per_unit(chip.value_or(flat), info, {{}, 1e-15, {}}))
      .read(0, 0, info.height, light.ptr<float>());
  std::vector<float> values(light.begin(), light.end());
  const double bright = std::max(sensor::quantile_fa(values, 0.995), 1e-30);
  cv::Mat picture;
  cv::pow(light / bright, 1 / 2.2, picture);
  picture.convertTo(picture, CV_8U, 255);
  if (picture.cols > 960) cv::resize(picture, picture, {960, picture.rows * 960 / picture.cols}, 0, 0, cv::INTER_AREA);
  return picture;
}

std::string scores(const metrics::Comparison& shared, const metrics::Comparison& eq16,
                   const metrics::Comparison& paper) {
  std::string html =
      "<table><tr><th>measure</th><th>real to simulated</th><th>split-half floor</th><th>normalisation</th></tr>";
  const auto line = [&](const char* name, double value, std::optional<double> floor, const char* note) {
    html +=
        fmt::format("<tr><td>{}</td><td class=\"n\">{:.4f}</td><td class=\"n\">{}</td><td class=\"note\">{}</td></tr>",
                    name, value, floor ? fmt::format("{:.4f}", *floor) : "none", note);
  };
  for (const auto& [c, note] :
       {std::pair{&shared, "shared: sensor size and common window"},
        {&eq16, "each stream by its own extremes (Eq. 16); hides shifts and different time scales"},
        {&paper, "as published: Eq. 16 with integer overflow and truncation"}}) {
    line("Chamfer distance", c->distance.chamfer(), c->floor ? std::optional(c->floor->chamfer()) : std::nullopt, note);
    line("Gaussian distance", c->distance.gaussian(), c->floor ? std::optional(c->floor->gaussian()) : std::nullopt,
         note);
  }
  return html +
         "</table><p>Lower is closer; 0 is identical; the Gaussian distance ends at 2. The <b>floor</b> is the "
         "distance "
         "between two random halves of the real recording: the noise floor of two recordings of one "
         "scene, at half the number of events. No simulation needs to be better than that.</p>";
}

// Pictures at the same times, and a player of the whole streams.
std::string event_pictures(const std::vector<const EventFile*>& streams, const std::vector<std::string>& names) {
  std::int64_t span_us = INT64_MAX;
  for (const EventFile* s : streams) span_us = std::min(span_us, s->recording.span_us);
  const std::int64_t window_us = readable_window_us(streams[0]->recording, span_us / 4 + 1);
  const int binning = std::max(1, streams[0]->recording.width / 640);
  std::string html = fmt::format(
      "<p>Each picture shows the events of {:.2f} ms. <span class=\"legend\" style=\"background: var(--on)\"></span>ON "
      "(brighter)<span class=\"legend\" style=\"background: var(--off)\"></span>OFF (darker). Times count from each "
      "stream's first event.</p><div id=\"player\" data-window=\"{}\" data-span=\"{}\"><div class=\"player\">"
      "<button>play</button><input type=\"range\" min=\"0\" max=\"1000\" value=\"300\" "
      "aria-label=\"time\"><output></output>"
      "</div><div class=\"pair\">",
      static_cast<double>(window_us) * 1e-3, window_us, span_us);
  for (std::size_t i = 0; i < streams.size(); ++i) {
    const events::Recording& s = streams[i]->recording;
    const std::size_t kept = std::min(s.events.size(), kPlayerEvents);
    html += fmt::format(
        "<figure><canvas width=\"{}\" height=\"{}\" data-binning=\"{}\" data-events=\"events{}\"></canvas>"
        "<figcaption>{}: {}{}</figcaption></figure>",
        (s.width + binning - 1) / binning, (s.height + binning - 1) / binning, binning, i, names[i],
        html_escaped(s.name),
        kept < s.events.size() ? fmt::format(" ({} of {} events, drawn at random)", kept, s.events.size()) : "");
  }
  html += "</div></div>";
  for (std::size_t i = 0; i < streams.size(); ++i)
    html += fmt::format("<script type=\"text/plain\" id=\"events{}\">{}</script>", i,
                        base64(packed_events(streams[i]->recording, kPlayerEvents)));

  for (const double part : {0.1, 0.5, 0.9}) {
    const auto from = static_cast<std::int64_t>(part * static_cast<double>(span_us - window_us));
    html += "<div class=\"pair\">";
    for (std::size_t i = 0; i < streams.size(); ++i)
      html +=
          fmt::format("<figure><img src=\"{}\" alt=\"events\"><figcaption>{}, {:.2f} … {:.2f} ms</figcaption></figure>",
                      png_source(event_frame(streams[i]->recording, from, from + window_us, kLight, binning)), names[i],
                      static_cast<double>(from) * 1e-3, static_cast<double>(from + window_us) * 1e-3);
    html += "</div><br>";
  }
  return html;
}

// Number and times of the frames, and their rate, or the range of their intervals where these differ.
std::string frame_rows(const std::vector<std::int64_t>& times_ns, std::int64_t rendered) {
  const auto ms = [](std::int64_t ns) { return static_cast<double>(ns) * 1e-6; };
  std::string rows = row("frames", fmt::format("{} of {}, {:.3f} to {:.3f} ms", rendered, times_ns.size(),
                                               ms(times_ns.front()), ms(times_ns.back())));
  if (times_ns.size() < 2) return rows;
  std::vector<std::int64_t> steps_ns(times_ns.size());
  std::adjacent_difference(times_ns.begin(), times_ns.end(), steps_ns.begin());
  const auto [shortest, longest] = std::minmax_element(steps_ns.begin() + 1, steps_ns.end());
  if (*longest - *shortest > 1)  // more than the rounding of times to 1 ns
    return rows + row("frame intervals", fmt::format("{:.3f} to {:.3f} ms", ms(*shortest), ms(*longest)));
  const double mean_ms = ms(times_ns.back() - times_ns.front()) / static_cast<double>(times_ns.size() - 1);
  return rows + row("frame rate", fmt::format("{:.6g} Hz", 1e3 / mean_ms));
}

std::string rendered(const Stack& stack, const std::optional<sensor::Chip>& chip) {
  const auto& info = stack.reader.info();
  std::string html;
  if (stack.reader.frames() > 0)
    html += fmt::format(
        "<figure><img class=\"preview\" src=\"{}\" alt=\"first frame\"><figcaption>First frame: brightness as "
        "the sensor's pixels see it{}, display gamma 2.2</figcaption></figure>",
        png_source(brightness(stack.reader, chip)),
        chip ? "" : " (constant quantum efficiency: the chip is not known)");
  html += "<table>" + frame_rows(info.times_ns, stack.reader.frames()) +
          row("pixels", fmt::format("{} x {}", info.width, info.height));
  if (info.period_ns) html += row("period", fmt::format("{:.3f} ms", static_cast<double>(*info.period_ns) * 1e-6));
  if (info.pixel_pitch_m) html += row("pixel pitch", fmt::format("{:.3f} µm", *info.pixel_pitch_m * 1e6));
  html +=
      row("quantity", info.quantity == sensor::Quantity::irradiance ? "spectral irradiance on the film (lens camera)"
                                                                    : "spectral radiance (pinhole)");
  html += "</table>";
  const Json scene = member(stack.json, "scene"), render = member(stack.json, "render");
  const std::string parameters = rows_of(member(scene, "parameters")), name = text_in(scene, "name");
  html += fmt::format("<h3>Scene: {}</h3>", name.empty() ? "not named" : html_escaped(name));
  html += parameters.empty() ? missing("stack.json names no scene parameters.") : "<table>" + parameters + "</table>";
  const std::string settings = rows_of(render);
  html += "<h3>Render settings</h3>";
  html += settings.empty() ? missing("stack.json names no render settings.") : "<table>" + settings + "</table>";
  return html;
}

std::string lens_section(const ReportInputs& inputs, const Stack* stack) {
  std::string html;
  if (inputs.lens_svg) {
    const std::string svg = read_text(*inputs.lens_svg, 8U << 20);
    html += fmt::format(
        "<figure><img class=\"smooth lens\" alt=\"lens with its rays\" src=\"data:image/svg+xml;base64,{}\">"
        "</figure>",
        base64({reinterpret_cast<const std::uint8_t*>(svg.data()), svg.size()}));
  } else {
    html += missing("No drawing was given (--lens-svg, made by `pecs lens draw`).");
  }
  if (!stack) return html + missing("No stack was given, so the lens it was rendered through is unknown.");
  const Json lens = member(stack->json, "lens");
  if (!lens.is_object()) return html + missing("The stack was rendered through a pinhole.");
  return html + "<table>" + rows_of(lens) + "</table>";
}

std::string bands_section(const Stack* stack, const std::optional<sensor::Chip>& chip) {
  std::string html;
  std::vector<Series> series;
  if (chip)
    series.push_back(
        {"relative quantum efficiency, " + chip->name, "on", chip->relative_qe.lambda_nm, chip->relative_qe.value});
  if (stack) {
    Series bands{"bands: weight / largest weight", "stem", {}, {}, true};
    double largest = 0;
    for (const auto& b : stack->reader.info().bands) largest = std::max(largest, b.weight_nm);
    for (const auto& b : stack->reader.info().bands)
      bands.x.push_back(b.lambda_nm), bands.y.push_back(b.weight_nm / largest);
    series.push_back(bands);
  }
  if (!series.empty()) html += line_plot(series, "wavelength (nm)", "relative");
  if (!chip)
    html +=
        missing("The chip is not known: the simulation has no run record, and stack.json names no installed profile.");
  if (!stack) return html + missing("No stack was given, so its bands are unknown.");
  html += "<table><tr><th>band (nm)</th><th>quadrature weight (nm)</th></tr>";
  for (const auto& b : stack->reader.info().bands)
    html += fmt::format("<tr><td class=\"n\">{:.2f}</td><td class=\"n\">{:.2f}</td></tr>", b.lambda_nm, b.weight_nm);
  return html + "</table>";
}

std::string details(const std::string& name, const Json& json) {
  return fmt::format("<details><summary>{}</summary><pre>{}</pre></details>", html_escaped(name),
                     html_escaped(pecs::text_of(json, 2)));
}

// Name and quantum efficiency of the chip that the run record lists, or else the profile that stack.json names.
std::optional<sensor::Chip> chip_of(const EventFile* sim, const Stack* stack) {
  if (sim && sim->run.contains("/config/chip/relative_qe"_json_pointer)) {
    JsonObject config = JsonObject(sim->run, sim->run_file()).object("config");
    JsonObject simulated = config.object("chip"), qe = simulated.object("relative_qe");
    sensor::Chip chip;
    chip.name = simulated.text("name");
    chip.relative_qe = {qe.numbers("lambda_nm"), qe.numbers("value")};
    if (const auto n = chip.relative_qe.value.size(); n < 2 || n != chip.relative_qe.lambda_nm.size())
      qe.fail("value", fmt::format("{} values", n), "one per wavelength, at least 2");
    return chip;
  }
  const auto name = "/render/chip"_json_pointer;
  if (!stack || !stack->json.contains(name) || !stack->json[name].is_string()) return {};
  try {
    return sensor::load_chip(stack->json[name]);
  } catch (const Error&) {
    return {};
  }
}

// Inputs of the page.
struct Inputs {
  std::optional<EventFile> real, sim;
  std::optional<Stack> stack;
  std::optional<sensor::Chip> chip;
  std::vector<std::string> warnings;
};

Inputs read(const ReportInputs& inputs) {
  Inputs m;
  if (inputs.real) m.real = read_events(*inputs.real);
  if (inputs.sim) m.sim = read_events(*inputs.sim);
  if (inputs.stack)
    m.stack = Stack{sensor::StackReader(*inputs.stack), parse_json_file(*inputs.stack / "stack.json"),
                    sha256_of_file(*inputs.stack / "stack.json")};
  m.chip = chip_of(m.sim ? &*m.sim : nullptr, m.stack ? &*m.stack : nullptr);
  if (!m.sim || !m.stack || !m.sim->run.is_object()) return m;
  bool same = false;
  for (const Json& input : member(m.sim->run, "inputs")) same |= text_in(input, "sha256") == m.stack->sha256;
  if (!same)
    m.warnings.push_back(
        "The simulated events were not simulated from this stack (their run record lists another one).");
  return m;
}

std::string cards_of(const metrics::Comparison& c) {
  std::string cards;
  const auto card = [&](const std::string& value, const std::string& name, const std::string& note) {
    cards += fmt::format("<div class=\"card\"><span>{}</span><b>{}</b><span>{}</span></div>", name, value, note);
  };
  const auto floor = [&](double (metrics::Distances::*of)() const) {
    return c.floor ? fmt::format("floor {:.3f} (0 is identical)", ((*c.floor).*of)()) : "";
  };
  card(fmt::format("{:.3f}", c.distance.chamfer()), "Chamfer distance", floor(&metrics::Distances::chamfer));
  card(fmt::format("{:.3f}", c.distance.gaussian()), "Gaussian distance", floor(&metrics::Distances::gaussian));
  card(fmt::format("{:.3f}", static_cast<double>(c.sim.events) / static_cast<double>(c.real.events)),
       "events, simulated / real", fmt::format("{} / {}", c.sim.events, c.real.events));
  card(fmt::format("{:.3f} / {:.3f}", c.sim.on_fraction, c.real.on_fraction), "ON fraction", "simulated / real");
  return "<div class=\"cards\">" + cards + "</div>";
}

std::string shift_sentence(const metrics::TimeShift& shift) {
  const std::string at = fmt::format("correlation of the polarity pictures {:.3f}, without shift {:.3f}",
                                     shift.correlation, shift.correlation_unshifted);
  if (shift.correlation < kLeastCorrelation) return fmt::format("<p>No time shift aligns the two ({}).</p>", at);
  return fmt::format(
      "<p>The two agree best when the simulation is shifted by {:+.2f} ms ({}). Pictures and scores show it without "
      "that shift.</p>",
      -shift.shift_us * 1e-3, at);
}

// Scores of the simulation against the recording; empty without both.
struct Scored {
  std::optional<metrics::Comparison> shared;
  std::string table, cards, shift;
};

Scored score(Inputs& m, metrics::CompareOptions options, Json& summary) {
  Scored out;
  if (!m.real || !m.sim) return out;
  const auto compared = [&](metrics::Normalisation normalisation) {
    options.normalisation = normalisation;
    return metrics::compare(stream_of(m.real->recording), m.real->path.string(), stream_of(m.sim->recording),
                            m.sim->path.string(), options);
  };
  out.shared = compared(metrics::Normalisation::shared);
  out.table = scores(*out.shared, compared(metrics::Normalisation::eq16), compared(metrics::Normalisation::paper));
  out.cards = cards_of(*out.shared);
  summary["compare"] = to_json(*out.shared);
  m.warnings.insert(m.warnings.end(), out.shared->warnings.begin(), out.shared->warnings.end());
  const auto range_us = std::min(m.real->recording.span_us, m.sim->recording.span_us) / 2;
  if (const auto shift = metrics::time_shift(m.real->recording, m.sim->recording, range_us)) {
    out.shift = shift_sentence(*shift);
    summary["time_shift"] = {{"shift_us", shift->shift_us},
                             {"correlation", shift->correlation},
                             {"correlation_unshifted", shift->correlation_unshifted}};
  }
  return out;
}

std::string counts(const metrics::Comparison& c) {
  std::string html = "<table><tr><th></th><th>real</th><th>simulated</th></tr>";
  const auto line = [&](const std::string& name, const std::string& a, const std::string& b) {
    html += fmt::format("<tr><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>", name, a, b);
  };
  const auto on = [](const metrics::StreamSummary& s) {
    return std::llround(s.on_fraction * static_cast<double>(s.events));
  };
  line("ON events", fmt::format("{}", on(c.real)), fmt::format("{}", on(c.sim)));
  line("OFF events", fmt::format("{}", static_cast<long long>(c.real.events) - on(c.real)),
       fmt::format("{}", static_cast<long long>(c.sim.events) - on(c.sim)));
  line("events per second", fmt::format("{:.4g}", c.real.rate_hz), fmt::format("{:.4g}", c.sim.rate_hz));
  return html + "</table>";
}

std::string configuration(const Inputs& m) {
  std::string html;
  if (m.sim)
    html += m.sim->run.is_object() ? details("Simulation: " + m.sim->path.filename().string() + ".run.json", m.sim->run)
                                   : missing("The simulation has no run record beside it.");
  if (m.real && m.real->run.is_object())
    html += details("Recording: " + m.real->path.filename().string() + ".run.json", m.real->run);
  if (m.stack) {
    Json shortened = m.stack->json;
    shortened["times_ns"] = fmt::format("{} times", m.stack->reader.info().times_ns.size());
    html += details("Render: stack.json", shortened);
  }
  return html;
}

std::string body_of(const Inputs& m, const Scored& scored, const ReportInputs& inputs) {
  const char* heading = m.real && m.sim ? "Simulated and recorded events"
                        : m.sim         ? "Simulated events"
                        : m.real        ? "A recording"
                                        : "A render";
  std::string body = fmt::format("<h1>{}</h1><p class=\"soft\">PECS {}</p>", heading, kVersion) + scored.cards;
  for (const auto& w : m.warnings) body += "<p><b>Note:</b> " + html_escaped(w) + "</p>";
  std::vector<const EventFile*> streams;
  std::vector<std::string> names;
  if (m.real) streams.push_back(&*m.real), names.push_back("real");
  if (m.sim) streams.push_back(&*m.sim), names.push_back("simulated");
  if (!streams.empty()) {
    body += "<h2>Events at the same times</h2>" + event_pictures(streams, names) + scored.shift;
    if (!m.real) body += missing("No real recording was given (--real).");
    if (!m.sim) body += missing("No simulated events were given (--sim).");
  }
  body += "<h2>Scores</h2>";
  body += scored.shared ? scored.table : missing("Needs a real recording (--real) and simulated events (--sim).");
  if (!streams.empty())
    body += "<h2>Event rate over time</h2>" +
            (scored.shared ? rate_plot(*scored.shared) : rate_plot(streams[0]->recording));
  if (scored.shared) body += counts(*scored.shared);
  const Stack* stack = m.stack ? &*m.stack : nullptr;
  body += "<h2>The render</h2>" + (stack ? rendered(*stack, m.chip) : missing("No stack was given (--stack)."));
  body += "<h2>The lens</h2>" + lens_section(inputs, stack);
  body += "<h2>Quantum efficiency and bands</h2>" + bands_section(stack, m.chip);
  return body + "<h2>Configuration and versions</h2>" + configuration(m);
}

}  // namespace

Json write_report_page(const ReportInputs& inputs, const std::filesystem::path& output) {
  if (!inputs.real && !inputs.sim && !inputs.stack)
    throw Error(ExitCode::usage, "report: got no input, wanted at least one of --real, --sim, --stack");
  Inputs m = read(inputs);
  Json summary = Json::object();
  const Scored scored = score(m, inputs.compare, summary);
  const EventFile* title = m.sim ? &*m.sim : m.real ? &*m.real : nullptr;
  write_file(output,
             fill_template(web::kReport,
                           {{"title", html_escaped(title ? title->recording.name : inputs.stack->filename().string())},
                            {"on_light", kLight.on.hex()},
                            {"off_light", kLight.off.hex()},
                            {"on_dark", kDark.on.hex()},
                            {"off_dark", kDark.off.hex()},
                            {"body", body_of(m, scored, inputs)}}));
  summary["output"] = output.string();
  summary["warnings"] = m.warnings;
  return summary;
}

}  // namespace pecs::view
