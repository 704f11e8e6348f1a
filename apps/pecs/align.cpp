// pecs align: what stands before the camera, measured in a recording.
#include <fmt/format.h>

#include <memory>
#include <opencv2/imgcodecs.hpp>

#include "commands.h"
#include "pecs/calibration/board.h"
#include "pecs/calibration/clock.h"
#include "pecs/calibration/disk.h"
#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/run_record.h"

namespace pecs::app {
namespace {

using namespace calibration;

void write_png(const std::string& path, const cv::Mat& picture) {
  std::vector<std::uint8_t> png;
  cv::imencode(".png", picture, png);
  AtomicFile file(path);
  file.write(std::as_bytes(std::span(png)));
  file.commit();
}

void warn(const std::string& line) { fmt::print(stderr, "pecs: warning: {}\n", line); }

Shown recording(const std::string& path) {
  std::string note;
  auto stream = with_steady_clock(events::read_all(path), path, note);
  if (!note.empty()) warn(path + ": " + note);
  return shown_of(std::move(stream), path, 0, INT64_MAX);
}

// ---- what a board looks like ----------------------------------------------------------------------------------------

struct BoardArguments {
  std::string target = "checkerboard";
  int columns = 0, rows = 0, views = 8;
  double spacing_mm = 1;
  bool blinking = false;
};

void add_board_options(CLI::App& command, BoardArguments& a) {
  command.add_option("--columns", a.columns, "Inner corners, or circles, in a row of the board")
      ->check(CLI::Range(2, 99));
  command.add_option("--rows", a.rows, "Inner corners, or circles, in a column")->check(CLI::Range(2, 99));
  command.add_option("--views", a.views, "Instants to look at, spread evenly over a recording")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command.add_flag("--blinking", a.blinking, "The board stands still and blinks");
}

BoardShape shape_of(const BoardArguments& a) {
  if (a.columns == 0 || a.rows == 0)
    throw Error(ExitCode::usage, "a board: got no --columns and --rows, wanted its inner corners or circles");
  const Pattern pattern = pattern_from(a.target);
  if (pattern == Pattern::checkerboard && (a.columns < 3 || a.rows < 3))
    throw Error(ExitCode::usage, fmt::format("--columns {} --rows {}: a checkerboard needs 3 x 3 inner corners or more",
                                             a.columns, a.rows));
  return {pattern, a.columns, a.rows, a.spacing_mm};
}

BoardSearch search_boards(const BoardArguments& a, const Shown& shown, const std::string& file, Blinking& blinking) {
  return a.blinking ? find_blinking_boards(shown, shape_of(a), a.views, file, blinking)
                    : find_boards(shown, shape_of(a), a.views, file);
}

// ---- detect ---------------------------------------------------------------------------------------------------------

struct DetectArguments {
  std::string events, output;
  BoardArguments board{.target = "disk"};
  bool json = false;
};

void say(const Disk& disk) {
  const auto line = [](const char* name, const Measured& m, const char* unit) {
    fmt::print("{:<12}{:10.3f} ± {:.3f} {}\n", name, m.value, m.deviation, unit);
  };
  fmt::print("disk of {} sectors, coherence {:.3f}, {} events\n", disk.sectors, disk.coherence, disk.events);
  line("centre x", disk.centre_x, "px");
  line("centre y", disk.centre_y, "px");
  line("speed", disk.speed_deg_s, "deg/s (positive: counter-clockwise on screen)");
  line("ON edge", disk.on_edge_deg, fmt::format("deg at t = {} us", disk.phase_time_us).c_str());
  line("OFF edge", disk.off_edge_deg, "deg");
  if (disk.rim.size.width > 0)
    fmt::print("{:<12}axes {:.2f} and {:.2f} px about ({:.2f}, {:.2f}), points within {:.2f} px rms\n", "rim",
               disk.rim.size.width, disk.rim.size.height, disk.rim.center.x, disk.rim.center.y, disk.rim_rms_px);
}

void say(const BoardSearch& search, const BoardShape& shape) {
  fmt::print("{} in {} of {} looks\n", shape.text(), search.views.size(), search.views.size() + search.missed.size());
  for (const auto& v : search.views)
    fmt::print("t = {:9.0f} us  first point ({:8.3f}, {:8.3f})  ± {:.3f} px  {} {:.0f} px/s\n", v.t_us, v.points[0].x,
               v.points[0].y, v.deviation_px, v.motion, v.speed_px_s);
}

void detect(const DetectArguments& a) {
  const bool is_disk = a.board.target == "disk";
  if (is_disk && (a.board.columns || a.board.rows || a.board.blinking))
    throw Error(ExitCode::usage, "--target disk: takes no --columns, --rows and --blinking");
  if (!is_disk) shape_of(a.board);  // wrong usage before long reading
  const Shown shown = recording(a.events);
  Json json;
  cv::Mat picture;
  if (is_disk) {
    const Disk disk = find_disk(shown, a.events);
    json = to_json(disk);
    picture = disk_picture(shown, disk, kLight);
    for (const auto& warning : disk.warnings) warn(warning);
    if (!a.json) say(disk);
  } else {
    const BoardShape shape = shape_of(a.board);
    Blinking blinking;
    const BoardSearch search = search_boards(a.board, shown, a.events, blinking);
    json = to_json(search, shape);
    if (a.board.blinking) json["frequency_hz"] = blinking.frequency_hz;
    picture = board_picture(search, shape);
    for (const auto& line : search.missed) warn("no board at " + line);
    if (!a.json) say(search, shape);
    if (!a.json && a.board.blinking) fmt::print("blinks at {:.2f} Hz\n", blinking.frequency_hz);
  }
  if (!a.output.empty()) {
    write_png(a.output, picture);
    write_run_record(a.output, {"align detect", arguments(), Json::object(), {a.events}, json});
  }
  if (a.json) fmt::print("{}\n", json.dump(2));
}

}  // namespace

void add_align(CLI::App& app) {
  auto* align = app.add_subcommand("align", "Measures the scene in a recording (docs/align.md)");
  align->require_subcommand(1);

  auto d = std::make_shared<DetectArguments>();
  auto* command = align->add_subcommand(
      "detect",
      "Finds a turning disk (centre, rim, speed, phase, sectors) or the points of a moving or blinking board");
  command->add_option("EVENTS", d->events, "Recording, any event format")->required();
  command->add_option("--target", d->board.target, "disk, checkerboard, circles or asymmetric-circles")
      ->capture_default_str();
  add_board_options(*command, d->board);
  command->add_option("-o,--output", d->output, "Picture of what was found (PNG)");
  command->add_flag("--json", d->json, "Machine-readable output");
  command->callback([d] { detect(*d); });
}

}  // namespace pecs::app
