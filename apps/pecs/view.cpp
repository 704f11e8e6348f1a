// pecs view EVENTS -o FILE: events as a picture (.png), a slow-motion video (.mp4) or an interactive page (.html).
#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <memory>

#include "commands.h"
#include "console.h"
#include "help.h"
#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/input/media.h"
#include "pecs/view/event_pictures.h"
#include "picture_file.h"
#include "units.h"

namespace pecs::app {
namespace {

constexpr double kLongest_us = 1e15;

struct ViewArguments {
  std::string events, output, theme = "light";
  double from_us = 0, to_us = 0, window_us = 0;
  int count = 6;
  double slow_motion = 0, fps = 30;
  std::size_t limit = 500'000;
  bool json = false;
  std::vector<std::pair<const CLI::Option*, std::string>> valid_for;  // outputs that an option changes
};

// The slow-motion factor (1, 2, 5, 10, …) of a video of about ten seconds.
double readable_slow_motion(std::int64_t span_us) {
  const double wanted = 10e6 / static_cast<double>(span_us);
  if (wanted <= 1) return 1;
  const double power = std::pow(10, std::floor(std::log10(wanted)));
  return wanted >= 5 * power ? 5 * power : wanted >= 2 * power ? 2 * power : power;
}

void run(const ViewArguments& a, Console& console) {
  const std::filesystem::path output = a.output;
  const std::string extension = output.extension().string();
  if (extension != ".png" && extension != ".mp4" && extension != ".html")
    throw Error(ExitCode::usage, fmt::format("-o: got '{}', wanted a name that ends in .png, .mp4 or .html", a.output));
  for (const auto& [option, extensions] : a.valid_for)
    if (option->count() > 0 && extensions.find(extension) == std::string::npos)
      throw Error(ExitCode::usage, fmt::format("{}: got {}, wanted a {}", option->get_name(), a.output, extensions));

  const auto to_us = a.to_us > 0 ? std::llround(a.to_us) : std::numeric_limits<std::int64_t>::max();
  events::Stream stream = a.to_us > 0 ? events::read_part(a.events, to_us) : events::read_all(a.events);
  const events::Recording recording = events::recording_of(std::move(stream), a.events, std::llround(a.from_us), to_us);
  const view::Theme& theme = events::theme_of(a.theme);

  Json result = {{"output", a.output},
                 {"events", recording.events.size()},
                 {"width", recording.width},
                 {"height", recording.height},
                 {"span_us", recording.span_us}};
  if (extension == ".png") {
    const std::int64_t window = a.window_us > 0 ? std::llround(a.window_us)
                                                : view::readable_window_us(recording, recording.span_us / a.count + 1);
    result["window_us"] = window;
    write_png(a.output, view::contact_sheet(recording, window, a.count, theme));
  } else if (extension == ".mp4") {
    view::VideoOptions video{.fps = a.fps,
                             .slow_motion = a.slow_motion > 0 ? a.slow_motion : readable_slow_motion(recording.span_us),
                             .window_us = std::llround(a.window_us),
                             .theme = theme};
    const auto info = view::write_video(recording, output, video);
    result["slow_motion"] = video.slow_motion;
    result["frames"] = info.frames;
    result["codec"] = info.codec;
  } else {
    result["events_in_page"] = view::write_page(recording, output, a.limit);
  }
  const Json config = {{"from_us", a.from_us}, {"to_us", a.to_us > 0 ? Json(a.to_us) : Json(nullptr)},
                       {"theme", a.theme},     {"count", a.count},
                       {"fps", a.fps},         {"limit", a.limit}};
  console.record(output, {.command = "view", .config = config, .inputs = {a.events}, .results = result});

  if (a.json) return print_json(result, 2);
  fmt::print("{}: {} events in {:.3f} ms", a.output, recording.events.size(),
             static_cast<double>(recording.span_us) * 1e-3);
  if (result.contains("slow_motion"))
    fmt::print(", {} frames, {:g} times slower", result["frames"].get<int>(), result["slow_motion"].get<double>());
  if (result.contains("events_in_page") && result["events_in_page"] < result["events"])
    fmt::print(", {} of them drawn at random (--limit)", result["events_in_page"].get<std::size_t>());
  fmt::print("\n");
}

}  // namespace

void write_png(const std::string& path, const cv::Mat& picture) {
  const std::vector<std::uint8_t> png = input::media().png_of(picture);
  write_file(path, std::as_bytes(std::span(png)));
}

void add_view(CLI::App& app, Console& console) {
  auto a = std::make_shared<ViewArguments>();
  auto* command = app.add_subcommand("view", "show events as a picture (.png), a video (.mp4) or a 3-D page (.html)");
  command->add_option("EVENTS", a->events, "event file, any format")->required();
  add_output(*command, "-o,--output", a->output, "file to write: .png, .mp4 or .html")->required();
  add_quantity(*command, "--from", a->from_us, "us", "start, from the first event")
      ->check(CLI::Range(0.0, kLongest_us));
  add_quantity(*command, "--to", a->to_us, "us", "end, from the first event (default: all)")
      ->check(CLI::Range(1.0, kLongest_us));
  const auto only = [&](const char* extensions, CLI::Option* option) { a->valid_for.emplace_back(option, extensions); };
  only(".png or .mp4", add_quantity(*command, "--window", a->window_us, "us",
                                    "png, mp4: duration of the events in one picture (default: readable)")
                           ->check(CLI::Range(1.0, kLongest_us)));
  only(".png", command->add_option("--count", a->count, "png: number of pictures")
                   ->check(CLI::Range(1, 100))
                   ->capture_default_str());
  only(".mp4",
       command->add_option("--slow-motion", a->slow_motion, "mp4: slow-motion factor (default: about 10 s of video)")
           ->check(CLI::Range(1.0, 1e7)));
  only(".mp4", add_quantity(*command, "--fps", a->fps, "Hz", "mp4: frames per second")
                   ->check(CLI::Range(1.0, 240.0))
                   ->capture_default_str());
  only(".html", command->add_option("--limit", a->limit, "html: maximum number of events, drawn at random")
                    ->check(CLI::Range(std::size_t{1}, std::size_t{20'000'000}))
                    ->capture_default_str());
  only(".png or .mp4", command->add_option("--theme", a->theme, "png, mp4: light or dark")
                           ->check(CLI::IsMember({"light", "dark"}))
                           ->capture_default_str());
  command->add_flag("--json", a->json, "machine-readable output");
  add_examples(*command,
               {"pecs view events.raw -o sheet.png --window 5ms",
                "pecs view events.raw -o slow.mp4 --from 20ms --to 40ms", "pecs view events.raw -o turn.html"});
  command->callback([a, &console] { run(*a, console); });
}

}  // namespace pecs::app
