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
#include "pecs/page/page.h"
#include "pecs/sensor/chip.h"
#include "pecs/sensor/photocurrent.h"
#include "pecs/sensor/stack.h"
#include "pecs/strict_json.h"
#include "pecs/text.h"
#include "pecs/version.h"
#include "pecs/view/compare_plot.h"
#include "pecs/view/event_pictures.h"

namespace pecs::view {

using namespace page;
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

Json row(const std::vector<std::string>& cells, const char* tag = "td") {
  Json out = Json::array({"tr"});
  for (const std::string& text : cells) out.push_back(element(tag, {}, text));
  return out;
}
Json missing(const std::string& text) { return element("p", {{"class", "missing"}}, text); }
Json table(const std::vector<std::string>& head, const Json& rows, const char* kind = "") {
  Json out = element("table", {{"class", kind}});
  if (!head.empty()) out.push_back(row(head, "th"));
  out.insert(out.end(), rows.begin(), rows.end());
  return out;
}
Json figure(const Json& inside, const std::string& caption) {
  return element("figure", {}, inside, element("figcaption", {}, caption));
}
Json picture(const cv::Mat& image, const std::string& caption, const char* kind = "") {
  const std::string source = "data:image/png;base64," + base64(input::media().png_of(image));
  return figure(element("img", {{"src", source}, {"class", kind}, {"alt", caption}}), caption);
}

constexpr std::size_t kMostListed = 16;

std::string text_of(const Json& value) {
  if (value.is_string()) return value.get<std::string>();
  if (value.is_number_float()) return fmt::format("{:.6g}", value.get<double>());
  if (value.is_array()) {
    if (value.empty()) return "none";
    if (value.size() > kMostListed) return fmt::format("{} values, listed below in stack.json", value.size());
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

// Table rows for an object of stack.json, whose values are {"value": …, "unit": …} or plain.
Json rows_of(const Json& object) {
  Json rows = Json::array();
  if (!object.is_object()) return rows;
  for (const auto& [key, value] : object.items()) {
    if (key.starts_with('_')) continue;
    if (value.is_object() && value.contains("value"))
      rows.push_back(
          row({words_of(key), text_of(value["value"]) + " " + text_in(value, "unit"), text_in(value, "about")}));
    else if (!value.is_object() && !value.is_null())
      rows.push_back(row({words_of(key), text_of(value)}));
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
  const double bright = std::max<double>(sensor::quantile({light.begin(), light.end()}, 0.995), 1e-30);
  cv::Mat picture;
  cv::pow(light / bright, 1 / 2.2, picture);
  picture.convertTo(picture, CV_8U, 255);
  if (picture.cols > 960) cv::resize(picture, picture, {960, picture.rows * 960 / picture.cols}, 0, 0, cv::INTER_AREA);
  return picture;
}

void add_scores(Json& page, const metrics::Comparison& shared, const metrics::Comparison& eq16,
                const metrics::Comparison& paper) {
  Json rows = Json::array();
  const auto line = [&](const char* name, double value, std::optional<double> floor, const char* note) {
    rows.push_back(row({name, fmt::format("{:.4f}", value), floor ? fmt::format("{:.4f}", *floor) : "none", note}));
  };
  for (const auto& [c, note] :
       {std::pair{&shared, "shared: sensor size and common window"},
        {&eq16, "each stream by its own extremes (Eq. 16); hides shifts and different time scales"},
        {&paper, "as published: Eq. 16 with integer overflow and truncation"}}) {
    line("Chamfer distance", c->distance.chamfer(), c->floor ? std::optional(c->floor->chamfer()) : std::nullopt, note);
    line("Gaussian distance", c->distance.gaussian(), c->floor ? std::optional(c->floor->gaussian()) : std::nullopt,
         note);
  }
  page.push_back(table({"measure", "real to simulated", "split-half floor", "normalisation"}, rows, "noted"));
  page.push_back(element(
      "p", {}, "Lower is closer; 0 is identical; the Gaussian distance ends at 2. The ", element("b", {}, "floor"),
      " is the distance between two random halves of the real recording: the noise floor of two "
      "recordings of one scene, at half the number of events. No simulation needs to be better than that."));
}

// Pictures at the same times, and a player of the whole streams.
void add_event_pictures(Json& page, const std::vector<const EventFile*>& streams,
                        const std::vector<std::string>& names) {
  std::int64_t span_us = INT64_MAX;
  for (const EventFile* s : streams) span_us = std::min(span_us, s->recording.span_us);
  const std::int64_t window_us = readable_window_us(streams[0]->recording, span_us / 4 + 1);
  const int binning = std::max(1, streams[0]->recording.width / 640);
  const auto swatch = [](const char* kind) { return element("span", {{"class", kind}}); };
  page.push_back(element(
      "p", {}, fmt::format("Each picture shows the events of {:.2f} ms. ", static_cast<double>(window_us) * 1e-3),
      swatch("legend on"), "ON (brighter)", swatch("legend off"),
      "OFF (darker). Times count from each stream's first event."));
  const Json slider =
      element("input", {{"type", "range"}, {"min", 0}, {"max", 1000}, {"value", 300}, {"aria-label", "time"}});
  Json canvases = element("div", {{"class", "pair"}});
  for (std::size_t i = 0; i < streams.size(); ++i) {
    const events::Recording& s = streams[i]->recording;
    const std::size_t kept = std::min(s.events.size(), kPlayerEvents);
    const std::string part =
        kept < s.events.size() ? fmt::format(" ({} of {} events, drawn at random)", kept, s.events.size()) : "";
    const Json size = {{"width", (s.width + binning - 1) / binning},
                       {"height", (s.height + binning - 1) / binning},
                       {"data-binning", binning},
                       {"data-events", base64(packed_events(s, kPlayerEvents))}};
    canvases.push_back(figure(element("canvas", size), names[i] + ": " + s.name + part));
  }
  page.push_back(element(
      "div", {{"id", "player"}, {"data-window", window_us}, {"data-span", span_us}},
      element("div", {{"class", "player"}}, element("button", {}, "play"), slider, element("output", {})), canvases));

  Json pair = element("div", {{"class", "pair"}});
  for (const double part : {0.1, 0.5, 0.9}) {
    const auto from = static_cast<std::int64_t>(part * static_cast<double>(span_us - window_us));
    for (std::size_t i = 0; i < streams.size(); ++i)
      pair.push_back(picture(event_frame(streams[i]->recording, from, from + window_us, kLight, binning),
                             fmt::format("{}, {:.2f} … {:.2f} ms", names[i], static_cast<double>(from) * 1e-3,
                                         static_cast<double>(from + window_us) * 1e-3)));
  }
  page.push_back(pair);
}

// Number and times of the frames, and their rate, or the range of their intervals where these differ. Keyframes have no
// rate: that of the light between them is a render setting.
void add_frame_rows(Json& rows, const std::vector<std::int64_t>& times_ns, std::int64_t rendered, bool keyframes) {
  const auto ms = [](std::int64_t ns) { return static_cast<double>(ns) * 1e-6; };
  rows.push_back(
      row({keyframes ? "keyframes" : "frames", fmt::format("{} of {}, {:.3f} to {:.3f} ms", rendered, times_ns.size(),
                                                           ms(times_ns.front()), ms(times_ns.back()))}));
  if (times_ns.size() < 2) return;
  std::vector<std::int64_t> steps_ns(times_ns.size());
  std::adjacent_difference(times_ns.begin(), times_ns.end(), steps_ns.begin());
  const auto [shortest, longest] = std::minmax_element(steps_ns.begin() + 1, steps_ns.end());
  const double mean_ms = ms(times_ns.back() - times_ns.front()) / static_cast<double>(times_ns.size() - 1);
  if (keyframes || *longest - *shortest > 1)  // more than the rounding of times to 1 ns
    rows.push_back(row({keyframes ? "keyframe intervals" : "frame intervals",
                        fmt::format("{:.3f} to {:.3f} ms", ms(*shortest), ms(*longest))}));
  else
    rows.push_back(row({"frame rate", fmt::format("{:.6g} Hz", 1e3 / mean_ms)}));
}

void add_render(Json& page, const Stack& stack, const std::optional<sensor::Chip>& chip) {
  const auto& info = stack.reader.info();
  if (stack.reader.frames() > 0)
    page.push_back(picture(brightness(stack.reader, chip),
                           fmt::format("First frame: brightness as the sensor's pixels see it{}, display gamma 2.2",
                                       chip ? "" : " (constant quantum efficiency: the chip is not known)"),
                           "preview"));
  Json rows = Json::array();
  add_frame_rows(rows, info.times_ns, stack.reader.frames(), member(stack.json, "between") == true);
  rows.push_back(row({"pixels", fmt::format("{} x {}", info.width, info.height)}));
  if (info.period_ns)
    rows.push_back(row({"period", fmt::format("{:.3f} ms", static_cast<double>(*info.period_ns) * 1e-6)}));
  if (info.pixel_pitch_m) rows.push_back(row({"pixel pitch", fmt::format("{:.3f} µm", *info.pixel_pitch_m * 1e6)}));
  rows.push_back(
      row({"quantity", info.quantity == sensor::Quantity::irradiance ? "spectral irradiance on the film (lens camera)"
                                                                     : "spectral radiance (pinhole)"}));
  page.push_back(table({}, rows));
  const Json scene = member(stack.json, "scene");
  const std::string name = text_in(scene, "name");
  for (const auto& [heading, object, what] :
       {std::tuple{"Scene: " + (name.empty() ? "not named" : name), member(scene, "parameters"), "scene parameters"},
        {std::string("Render settings"), member(stack.json, "render"), "render settings"}}) {
    const Json values = rows_of(object);
    page.push_back(element("h3", {}, heading));
    page.push_back(values.empty() ? missing(fmt::format("stack.json names no {}.", what)) : table({}, values, "noted"));
  }
}

void add_lens(Json& page, const ReportInputs& inputs, const Stack* stack) {
  if (inputs.lens_svg) {
    const std::string svg = read_text(*inputs.lens_svg, 8U << 20);
    const std::span bytes(reinterpret_cast<const std::uint8_t*>(svg.data()), svg.size());
    const Json image =
        element("img", {{"src", "data:image/svg+xml;base64," + base64(bytes)}, {"class", "smooth lens"}});
    page.push_back(element("figure", {}, image));
  } else {
    page.push_back(missing("No drawing was given (--lens-svg, made by `pecs lens draw`)."));
  }
  const Json lens = stack ? member(stack->json, "lens") : Json();
  page.push_back(lens.is_object() ? table({}, rows_of(lens), "noted")
                 : !stack         ? missing("No stack was given, so the lens it was rendered through is unknown.")
                 : stack->reader.info().quantity == sensor::Quantity::irradiance
                     ? missing("stack.json names no lens.")
                     : missing("The stack was rendered through a pinhole."));
}

void add_bands(Json& page, const Stack* stack, const std::optional<sensor::Chip>& chip) {
  Json series = Json::array(), rows = Json::array();
  if (chip)
    series.push_back({{"name", "relative quantum efficiency, " + chip->name},
                      {"style", "on"},
                      {"x", chip->relative_qe.lambda_nm},
                      {"y", chip->relative_qe.value}});
  if (stack) {
    const auto& bands = stack->reader.info().bands;
    std::vector<double> x, y;
    for (const auto& b : bands) {
      x.push_back(b.lambda_nm), y.push_back(b.weight_nm);
      rows.push_back(row({fmt::format("{:.2f}", b.lambda_nm), fmt::format("{:.2f}", b.weight_nm)}));
    }
    const double largest = *std::ranges::max_element(y);
    for (double& weight : y) weight /= largest;
    series.push_back(
        {{"name", "bands: weight / largest weight"}, {"style", "stem"}, {"x", x}, {"y", y}, {"stems", true}});
  }
  if (!series.empty()) page.push_back(element("plot", {{"plot", series}, {"x", "wavelength (nm)"}, {"y", "relative"}}));
  if (!chip)
    page.push_back(
        missing("The chip is not known: the simulation has no run record, and stack.json names no installed profile."));
  page.push_back(stack ? table({"band (nm)", "quadrature weight (nm)"}, rows)
                       : missing("No stack was given, so its bands are unknown."));
}

Json details(const std::string& name, const Json& json) {
  return element("details", {}, element("summary", {}, name), element("pre", {}, pecs::text_of(json, 2)));
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

Json cards_of(const metrics::Comparison& c) {
  Json cards = element("div", {{"class", "cards"}});
  const auto card = [&](const std::string& value, const std::string& name, const std::string& note) {
    cards.push_back(element("div", {{"class", "card"}}, element("span", {}, name), element("b", {}, value),
                            element("span", {}, note)));
  };
  const auto floor = [&](double (metrics::Distances::*of)() const) {
    return c.floor ? fmt::format("floor {:.3f} (0 is identical)", ((*c.floor).*of)()) : "";
  };
  card(fmt::format("{:.3f}", c.distance.chamfer()), "Chamfer distance", floor(&metrics::Distances::chamfer));
  card(fmt::format("{:.3f}", c.distance.gaussian()), "Gaussian distance", floor(&metrics::Distances::gaussian));
  card(fmt::format("{:.3f}", static_cast<double>(c.sim.events) / static_cast<double>(c.real.events)),
       "events, simulated / real", fmt::format("{} / {}", c.sim.events, c.real.events));
  card(fmt::format("{:.3f} / {:.3f}", c.sim.on_fraction, c.real.on_fraction), "ON fraction", "simulated / real");
  return cards;
}

// A sentence for each number of the cards, and which value of the scene or the sensor changes it.
Json advice_of(const metrics::Comparison& c) {
  Json list = element("ul", {});
  const auto add = [&](const std::string& sentence) { list.push_back(element("li", {}, sentence)); };
  if (c.floor)
    add(
        fmt::format("Chamfer distance: mean distance in time and space from each event to the nearest one of the other "
                    "file, {:.2f} times the floor. It is nearly blind to missing and late events.",
                    c.distance.chamfer() / c.floor->chamfer()));
  const double ratio = static_cast<double>(c.sim.events) / static_cast<double>(c.real.events);
  const std::string counted = fmt::format("Number of events: {:.2f} times the recording's. ", ratio);
  if (ratio < 0.9)
    add(counted +
        "Too few: the scene is too dim for pixels to follow (illuminance, lamp, f-number), its contrast is too "
        "low, or the thresholds are too high.");
  else if (ratio > 1.1)
    add(counted +
        "Too many: the contrast is too high, the thresholds are too low, or events come from noise of the "
        "renderer (samples) or of the chip in light that is too dim.");
  else
    add(counted + "Thresholds, contrast and light fit within 10 %.");
  if (std::abs(c.sim.on_fraction - c.real.on_fraction) > 0.03)
    add(fmt::format(
        "ON fraction: {:+.3f} from the recording's. The thresholds of ON and OFF are not those of the camera "
        "(contrast_threshold_on, contrast_threshold_off), or its leak (leak_rate_hz).",
        c.sim.on_fraction - c.real.on_fraction));
  if (c.map_correlation)
    add(fmt::format("Correlation of the event maps: {:.3f}. {}", *c.map_correlation,
                    *c.map_correlation < 0.9
                        ? "Events are in other places: pose, size of the target or lens do not match."
                        : "Events are in the same places."));
  if (c.realism)
    for (const auto& sentence : metrics::sentences(*c.realism)) add(sentence);
  add("Delays behind edges (`pecs compare --disk find`, or the time shift below): events that come too early or too "
      "late "
      "behind an edge mean wrong light; ON and OFF shifted alike mean a wrong phase or clock; too many or too few "
      "events "
      "of an edge mean wrong contrast or thresholds. Change the scene before the sensor.");
  return list;
}

std::string shift_sentence(const metrics::TimeShift& shift) {
  const std::string at = fmt::format("correlation of the polarity pictures {:.3f}, without shift {:.3f}",
                                     shift.correlation, shift.correlation_unshifted);
  if (shift.correlation < kLeastCorrelation) return fmt::format("No time shift aligns the two ({}).", at);
  return fmt::format(
      "The two agree best when the simulation is shifted by {:+.2f} ms ({}). Pictures and scores show it without that "
      "shift. Times count from the first event of each: if the recording's is not at 0, `pecs sense --start` takes its "
      "time.",
      -shift.shift_us * 1e-3, at);
}

// Scores of the simulation against the recording; empty without both.
struct Scored {
  std::optional<metrics::Comparison> shared;
  Json table = Json::array();
  std::string shift;
};

Scored score(Inputs& m, metrics::CompareOptions options, Json& summary) {
  Scored out;
  if (!m.real || !m.sim) return out;
  const auto compared = [&](metrics::Normalisation normalisation) {
    options.normalisation = normalisation;
    return metrics::compare(stream_of(m.real->recording), m.real->path.string(), stream_of(m.sim->recording),
                            m.sim->path.string(), options);
  };
  options.realism = true;
  out.shared = compared(metrics::Normalisation::shared);
  options.realism = false;
  add_scores(out.table, *out.shared, compared(metrics::Normalisation::eq16), compared(metrics::Normalisation::paper));
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

Json counts(const metrics::Comparison& c) {
  Json rows = Json::array();
  const auto line = [&](const std::string& name, const std::string& a, const std::string& b) {
    rows.push_back(row({name, a, b}));
  };
  const auto on = [](const metrics::StreamSummary& s) {
    return std::llround(s.on_fraction * static_cast<double>(s.events));
  };
  line("ON events", fmt::format("{}", on(c.real)), fmt::format("{}", on(c.sim)));
  line("OFF events", fmt::format("{}", static_cast<long long>(c.real.events) - on(c.real)),
       fmt::format("{}", static_cast<long long>(c.sim.events) - on(c.sim)));
  line("events per second", fmt::format("{:.4g}", c.real.rate_hz), fmt::format("{:.4g}", c.sim.rate_hz));
  return table({"", "real", "simulated"}, rows);
}

void add_configuration(Json& page, const Inputs& m) {
  const auto record = [](const EventFile& file) { return file.path.filename().string() + ".run.json"; };
  if (m.sim)
    page.push_back(m.sim->run.is_object() ? details("Simulation: " + record(*m.sim), m.sim->run)
                                          : missing("The simulation has no run record."));
  if (m.real && m.real->run.is_object()) page.push_back(details("Recording: " + record(*m.real), m.real->run));
  if (m.stack) {
    Json shortened = m.stack->json;
    shortened["times_ns"] = fmt::format("{} times", m.stack->reader.info().times_ns.size());
    page.push_back(details("Render: stack.json", shortened));
  }
}

Json body_of(const Inputs& m, const Scored& scored, const ReportInputs& inputs) {
  const char* title = m.real && m.sim ? "Simulated and recorded events"
                      : m.sim         ? "Simulated events"
                      : m.real        ? "A recording"
                                      : "A render";
  Json page = Json::array();
  const auto heading = [&](const char* text) { page.push_back(element("h2", {}, text)); };
  page.push_back(element("h1", {}, title));
  page.push_back(element("p", {{"class", "soft"}}, fmt::format("PECS {}", kVersion)));
  if (scored.shared) {
    page.push_back(cards_of(*scored.shared));
    heading("Meaning of the numbers, and what to change");
    page.push_back(advice_of(*scored.shared));
  }
  for (const auto& w : m.warnings) page.push_back(element("p", {}, element("b", {}, "Note: "), w));
  std::vector<const EventFile*> streams;
  std::vector<std::string> names;
  if (m.real) streams.push_back(&*m.real), names.push_back("real");
  if (m.sim) streams.push_back(&*m.sim), names.push_back("simulated");
  if (!streams.empty()) {
    heading("Events at the same times");
    add_event_pictures(page, streams, names);
    if (!scored.shift.empty()) page.push_back(element("p", {}, scored.shift));
    if (!m.real) page.push_back(missing("No real recording was given (--real)."));
    if (!m.sim) page.push_back(missing("No simulated events were given (--sim)."));
  }
  heading("Scores");
  page.insert(page.end(), scored.table.begin(), scored.table.end());
  if (!scored.shared) page.push_back(missing("Needs a real recording (--real) and simulated events (--sim)."));
  if (!streams.empty()) {
    heading("Event rate over time");
    page.push_back(scored.shared ? rate_plot(*scored.shared) : rate_plot(streams[0]->recording));
  }
  if (scored.shared) page.push_back(counts(*scored.shared));
  const Stack* stack = m.stack ? &*m.stack : nullptr;
  heading("The render");
  if (stack)
    add_render(page, *stack, m.chip);
  else
    page.push_back(missing("No stack was given (--stack)."));
  heading("The lens");
  add_lens(page, inputs, stack);
  heading("Quantum efficiency and bands");
  add_bands(page, stack, m.chip);
  heading("Configuration and versions");
  add_configuration(page, m);
  return page;
}

}  // namespace

Json write_report_page(const ReportInputs& inputs, const std::filesystem::path& output) {
  if (!inputs.real && !inputs.sim && !inputs.stack)
    throw Error(ExitCode::usage, "report: got no input, wanted at least one of --real, --sim, --stack");
  Inputs m = read(inputs);
  Json summary = Json::object();
  const Scored scored = score(m, inputs.compare, summary);
  const EventFile* title = m.sim ? &*m.sim : m.real ? &*m.real : nullptr;
  const std::string name = title ? title->recording.name : inputs.stack->filename().string();
  write_file(output, page_of({{"title", "PECS report: " + name}, {"body", body_of(m, scored, inputs)}}));
  summary["output"] = output.string();
  summary["warnings"] = m.warnings;
  return summary;
}

}  // namespace pecs::view
