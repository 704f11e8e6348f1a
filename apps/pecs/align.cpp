// pecs align: measures targets and camera in recordings.
#include "pecs/calibration/align.h"

#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <set>

#include "commands.h"
#include "console.h"
#include "help.h"
#include "pecs/calibration/board.h"
#include "pecs/calibration/disk.h"
#include "pecs/calibration/intrinsics.h"
#include "pecs/calibration/timestamp_wrap.h"
#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/input/media.h"
#include "pecs/text.h"
#include "picture_file.h"
#include "units.h"

namespace pecs::app {
namespace {

using namespace calibration;

events::Recording read_recording(const std::string& path, const Console& console) {
  std::string note;
  auto stream = unwrap_timestamps(events::read_all(path), path, note);
  if (!note.empty()) console.warn(path + ": " + note);
  return events::recording_of(std::move(stream), path, 0, INT64_MAX);
}

// ---- boards ---------------------------------------------------------------------------------------------------------

struct BoardArguments {
  std::string target = "checkerboard";
  int columns = 0, rows = 0, views = 8;
  double spacing_mm = 1;
  bool blinking = false;
};

void add_board_options(CLI::App& command, BoardArguments& a) {
  command.add_option("--columns", a.columns, "inner corners, or circles, in a row of the board")
      ->check(CLI::Range(2, 99));
  command.add_option("--rows", a.rows, "inner corners, or circles, in a column")->check(CLI::Range(2, 99));
  command.add_option("--views", a.views, "times at which to search, spread evenly over a recording")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command.add_flag("--blinking", a.blinking, "the board is static and blinks");
}

BoardShape shape_of(const BoardArguments& a) {
  if (a.columns == 0 || a.rows == 0)
    throw Error(ExitCode::usage, "a board requires --columns and --rows: its inner corners or circles");
  const Pattern pattern = pattern_from(a.target);
  if (pattern == Pattern::checkerboard && (a.columns < 3 || a.rows < 3))
    throw Error(ExitCode::usage, fmt::format("--columns {} --rows {}: a checkerboard needs 3 x 3 inner corners or more",
                                             a.columns, a.rows));
  return {pattern, a.columns, a.rows, a.spacing_mm};
}

BoardSearch search_boards(const BoardArguments& a, const events::Recording& recording, const std::string& file,
                          Blinking& blinking) {
  return a.blinking ? find_blinking_boards(recording, shape_of(a), a.views, file, blinking)
                    : find_boards(recording, shape_of(a), a.views, file);
}

// ---- detect ---------------------------------------------------------------------------------------------------------

struct DetectArguments {
  std::string events, output;
  BoardArguments board{.target = "disk"};
  bool json = false;
};

void print(const DetectedDisk& disk) {
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

void print(const BoardSearch& search, const BoardShape& shape) {
  fmt::print("{} at {} of {} times\n", shape.text(), search.views.size(), search.views.size() + search.missed.size());
  for (const auto& v : search.views)
    fmt::print("t = {:9.0f} us  first point ({:8.3f}, {:8.3f})  ± {:.3f} px  {} {:.0f} px/s\n", v.t_us, v.points[0].x,
               v.points[0].y, v.deviation_px, v.motion, v.speed_px_s);
}

void detect(const DetectArguments& a, Console& console) {
  const bool is_disk = a.board.target == "disk";
  if (is_disk && (a.board.columns || a.board.rows || a.board.blinking))
    throw Error(ExitCode::usage, "--columns, --rows and --blinking are valid only for a board, not for --target disk");
  if (!is_disk) shape_of(a.board);  // usage errors before the recording is read
  const events::Recording recording = read_recording(a.events, console);
  Json json;
  cv::Mat picture;
  if (is_disk) {
    const DetectedDisk disk = find_disk(recording, a.events);
    json = to_json(disk);
    picture = disk_picture(recording, disk, view::kLight);
    for (const auto& warning : disk.warnings) console.warn(warning);
    if (!a.json) print(disk);
  } else {
    const BoardShape shape = shape_of(a.board);
    Blinking blinking;
    const BoardSearch search = search_boards(a.board, recording, a.events, blinking);
    json = to_json(search, shape);
    if (a.board.blinking) json["frequency_hz"] = blinking.frequency_hz;
    picture = board_picture(search, shape);
    for (const auto& line : search.missed) console.warn("no board at " + line);
    if (!a.json) print(search, shape);
    if (!a.json && a.board.blinking) fmt::print("blinks at {:.2f} Hz\n", blinking.frequency_hz);
  }
  if (!a.output.empty()) {
    write_png(a.output, picture);
    console.record(a.output, {"align detect", Json::object(), {a.events}, json});
  }
  if (a.json) print_json(json, 2);
}

// ---- intrinsics -----------------------------------------------------------------------------------------------------

struct IntrinsicsArguments {
  std::vector<std::string> inputs;
  std::string output, picture, model = "pinhole";
  BoardArguments board;
  IntrinsicsOptions options;
  LensSetting lens;
  bool json = false;
};

bool is_picture(const std::string& path) {
  static const std::set<std::string> extensions = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp"};
  return extensions.contains(lower(std::filesystem::path(path).extension().string()));
}

// Views of a board in recordings and pictures of one camera.
struct Gathered {
  std::vector<std::vector<cv::Point2d>> views;
  cv::Size size;
  std::vector<std::string> missed;
};

Gathered gather(const IntrinsicsArguments& a, const BoardShape& shape, const Console& console) {
  Gathered g;
  const auto one_size = [&](cv::Size size, const std::string& file) {
    if (!g.size.empty() && g.size != size)
      throw bad_input(file, "size", fmt::format("{} x {} pixels", size.width, size.height),
                      fmt::format("{} x {}, as in the previous inputs", g.size.width, g.size.height));
    g.size = size;
  };
  for (const auto& input : a.inputs) {
    if (is_picture(input)) {
      const cv::Mat picture = input::media().read_picture(input, cv::IMREAD_GRAYSCALE);
      if (picture.empty()) throw not_found(input, "not a readable picture");
      one_size(picture.size(), input);
      std::string why;
      auto points = board_points(picture, shape, why);
      if (points.empty())
        g.missed.push_back(fmt::format("{}: {}", input, why));
      else
        g.views.push_back(std::move(points));
      continue;
    }
    const events::Recording recording = read_recording(input, console);
    one_size({recording.width, recording.height}, input);
    Blinking blinking;
    try {
      BoardSearch search = search_boards(a.board, recording, input, blinking);
      for (auto& view : search.views) g.views.push_back(std::move(view.points));
      for (const auto& line : search.missed) g.missed.push_back(fmt::format("{}: {}", input, line));
    } catch (const Error& e) {
      if (e.code() != ExitCode::bad_input) throw;
      g.missed.emplace_back(e.what());
    }
  }
  return g;
}

void intrinsics(IntrinsicsArguments& a, Console& console) {
  const BoardShape shape = shape_of(a.board);
  a.options.fisheye = a.model == "fisheye";
  const Gathered g = gather(a, shape, console);
  for (const auto& line : g.missed) console.warn("no board in " + line);
  const std::string file = a.inputs.size() == 1 ? a.inputs[0] : fmt::format("{} inputs", a.inputs.size());
  const Intrinsics in = intrinsics_of(g.views, shape, g.size, a.options, file);
  for (const auto& line : in.warnings) console.warn(line);
  Json json = to_json(in);
  std::vector<CurveRow> curve;
  if (!a.lens.lens.empty()) {
    const Optics predicted = optics_of(a.lens, g.size);
    curve = compare_curves(predicted, optics_of(in.camera), g.size);
    Json rows = Json::array();
    double worst = 0;
    for (const auto& r : curve) {
      rows.push_back({{"angle_deg", r.angle_deg},
                      {"predicted_px", r.predicted_px},
                      {"measured_px", r.measured_px},
                      {"shape_difference_px", r.shape_difference_px}});
      worst = std::max(worst, std::abs(r.shape_difference_px));
    }
    json["lens"] = {{"lens", a.lens.lens},
                    {"predicted_focal_px", predicted.focal_px()},
                    {"worst_shape_difference_px", worst},
                    {"curve", rows}};
  }
  std::vector<std::filesystem::path> inputs(a.inputs.begin(), a.inputs.end());
  if (!a.picture.empty()) write_png(a.picture, coverage_picture(g.views, in, shape, curve));
  if (!a.output.empty()) {
    write_file(a.output, text_of(json, 2) + "\n");
    console.record(a.output, {"align intrinsics", Json::object(), inputs, json});
  }
  if (a.json) return print_json(json, 2);
  const CameraModel &c = in.camera, &d = in.deviation;
  fmt::print("{} of {} views, {:.3f} px rms, {:.0f} % of the picture covered\n", in.rotation.size(),
             g.views.size() + g.missed.size(), in.rms_px, 100 * in.coverage);
  fmt::print("focal       {:10.2f} ± {:.2f} px\n", c.focal_px, d.focal_px);
  fmt::print("principal x {:10.2f} ± {:.2f} px\n", c.principal_px.x, d.principal_px.x);
  fmt::print("principal y {:10.2f} ± {:.2f} px\n", c.principal_px.y, d.principal_px.y);
  for (std::size_t i = 0; i < c.radial.size(); ++i)
    fmt::print("k{}          {:10.5f} ± {:.5f}\n", i + 1, c.radial[i], d.radial[i]);
  if (a.options.tangential)
    fmt::print("p1, p2      {:.6f} ± {:.6f}, {:.6f} ± {:.6f}\n", c.tangential.x, d.tangential.x, c.tangential.y,
               d.tangential.y);
  if (!curve.empty()) {
    fmt::print("\n{:>8} {:>12} {:>12} {:>12}\n", "deg", "lens px", "measured px", "shape px");
    for (const auto& r : curve)
      fmt::print("{:8.2f} {:12.2f} {:12.2f} {:12.3f}\n", r.angle_deg, r.predicted_px, r.measured_px,
                 r.shape_difference_px);
  }
}

// ---- align ----------------------------------------------------------------------------------------------------------

struct AlignArguments {
  std::string real, scene, output, picture, sim, sim_of, camera, clock = "file";
  std::optional<double> pixel_pitch_um;
  Search search;
  bool json = false;
};

Optics optics_for(const AlignArguments& a, const LabScene& scene, cv::Size size) {
  if (!a.camera.empty()) {
    const Json json = parse_json_file(a.camera);
    const CameraModel camera = camera_from(JsonObject(json, a.camera).object("camera"));
    if (camera.size != size)
      throw bad_input(a.real, "size", fmt::format("{} x {} pixels", size.width, size.height),
                      fmt::format("{} x {}, as in {}", camera.size.width, camera.size.height, a.camera));
    return optics_of(camera);
  }
  LensSetting lens = scene.lens;
  if (a.pixel_pitch_um)
    lens.pixel_pitch_um = *a.pixel_pitch_um;
  else if (size != cv::Size(1280, 720))
    throw bad_input(a.real, "size", fmt::format("{} x {} pixels", size.width, size.height),
                    "1280 x 720 of 4.86 um, or --pixel-pitch, or --camera");
  return optics_of(lens, size);
}

void align_recording(const AlignArguments& a, Console& console) {
  if (a.real.empty() || a.scene.empty())
    throw Error(ExitCode::usage, "align: requires a recording and --scene, or a subcommand");
  if (a.sim.empty() && !a.sim_of.empty()) throw Error(ExitCode::usage, "--sim-of: valid only with --sim");
  const LabScene original = load_lab_scene(a.scene);
  LabScene scene = original;
  if (!a.sim_of.empty()) apply_aligned(scene, a.sim_of);
  const events::Recording real = read_recording(a.real, console);
  const Optics optics = optics_for(a, scene, {real.width, real.height});
  const TargetEstimate found = find_in_recording(real, scene, optics, a.search, a.real);
  const ClockModel clock = a.clock == "file"     ? ClockModel::file
                           : a.clock == "offset" ? ClockModel::offset
                                                 : ClockModel::offset_and_rate;
  std::optional<events::Recording> sim;
  Aligned aligned;
  if (a.sim.empty()) {
    aligned = align_scene(scene, found, clock);
  } else {
    sim = read_recording(a.sim, console);
    if (sim->width != real.width || sim->height != real.height)
      throw bad_input(a.sim, "size", fmt::format("{} x {} pixels", sim->width, sim->height),
                      fmt::format("{} x {}, as in {}", real.width, real.height, a.real));
    const TargetEstimate in_sim = find_in_recording(*sim, scene, optics, a.search, a.sim);
    aligned = align_scene(scene, found, in_sim, clock);
    const cv::Vec3d apart = found.position_mm - in_sim.position_mm;
    aligned.json["simulation"] = {
        {"right_mm", apart[0]}, {"up_mm", apart[1]}, {"distance_mm", apart[2]}, {"residual", in_sim.residual}};
  }
  for (const auto& line : aligned.json["warnings"]) console.warn(line.get<std::string>());
  if (!a.picture.empty()) write_png(a.picture, overlay_picture(real, original, aligned, optics, sim ? &*sim : nullptr));
  if (!a.output.empty()) {
    write_file(a.output, text_of(aligned.json, 2) + "\n");
    std::vector<std::filesystem::path> inputs = {a.real, original.file};
    if (sim) inputs.emplace_back(a.sim);
    console.record(a.output, {"align", Json::object(), inputs, aligned.json});
  }
  if (a.json) return print_json(aligned.json, 2);
  for (const auto& [key, value] : aligned.json["parameters"].items())
    fmt::print("{:<18}{:12.4f} ± {:.4f}  (was {:.4f})\n", key, value.get<double>(),
               found.deviation.contains(key) ? found.deviation.at(key) : 0.0, original.values.at(key));
  for (const auto& [key, value] : aligned.json["not_estimated"].items())
    fmt::print("{:<18}{:>12}   (the scene's, not estimated: measure it, and set it by --set)\n", key, text_of(value));
  const cv::Vec3d r = aligned.scene.rotation_deg;
  fmt::print("{:<18}{:.4f} {:.4f} {:.4f} deg (Blender, XYZ)\n", "camera rotation", r[0], r[1], r[2]);
  fmt::print("{:<18}offset {:.1f} us, rate {:.6f}\n", "clock", aligned.clock_offset_us, aligned.clock_rate);
  for (const auto& [key, value] : found.residual.items()) fmt::print("{:<26}{}\n", key, text_of(value));
}

}  // namespace

void add_align(CLI::App& app, Console& console) {
  auto* align =
      app.add_subcommand("align", "estimate the parameters of a scene from a recording (docs/reference/align.md)");
  align->require_subcommand(0, 1);

  auto a = std::make_shared<AlignArguments>();
  align->add_option("REAL", a->real, "recording of a lab scene, any event format");
  align->add_option("--scene", a->scene, "folder of the scene: scenes/board, scenes/rotating_disk");
  add_output(*align, "-o,--output", a->output, "aligned.json, for `pecs_blender render --set @aligned.json`");
  add_output(*align, "--picture", a->picture, "overlay of the recording before and after (PNG)");
  align->add_option("--sim", a->sim, "events simulated from the scene, which correct the result");
  align->add_option("--sim-of", a->sim_of, "aligned.json of the simulation (default: the scene's values)");
  align->add_option("--camera", a->camera, "camera from `pecs align intrinsics` instead of the scene's lens");
  add_quantity(*align, "--pixel-pitch", a->pixel_pitch_um, "um",
               "pixel pitch of a sensor other than 1280 x 720 of 4.86um");
  align->add_option("--views", a->search.views, "times at which to search a board")
      ->check(CLI::Range(3, 1000))
      ->capture_default_str();
  align->add_flag("--hold-camera", a->search.hold_camera, "keep the camera rotation of the scene (or of --sim-of)");
  align
      ->add_option(
          "--clock", a->clock,
          "file: the file's clock is the scene's; offset: estimate its offset instead of the start (phase); both: "
          "also its rate instead of the speed")
      ->check(CLI::IsMember({"file", "offset", "both"}))
      ->capture_default_str();
  align->add_flag("--json", a->json, "machine-readable output");
  add_examples(*align, {"pecs align recording.raw --scene scenes/rotating_disk -o aligned.json --picture aligned.png",
                        "pecs align detect recording.raw"});
  align->callback([align, a, &console] {
    if (align->get_subcommands().empty()) align_recording(*a, console);
  });

  auto d = std::make_shared<DetectArguments>();
  auto* command = align->add_subcommand(
      "detect",
      "detect a rotating disk (centre, rim, speed, phase, sectors) or the points of a moving or blinking board");
  command->add_option("EVENTS", d->events, "recording, any event format")->required();
  command->add_option("--target", d->board.target, "disk, checkerboard, circles or asymmetric-circles")
      ->capture_default_str();
  add_board_options(*command, d->board);
  add_output(*command, "-o,--output", d->output, "picture of the detection (PNG)");
  command->add_flag("--json", d->json, "machine-readable output");
  add_examples(*command, {"pecs align detect recording.raw -o found.png",
                          "pecs align detect recording.raw --target checkerboard --columns 8 --rows 5"});
  command->callback([d, &console] { detect(*d, console); });

  auto i = std::make_shared<IntrinsicsArguments>();
  command = align->add_subcommand("intrinsics", "calibrate a camera from views of a board in recordings or pictures");
  command->add_option("INPUT", i->inputs, "recordings (any event format) and pictures of one camera")->required();
  command->add_option("--target", i->board.target, "checkerboard, circles or asymmetric-circles")
      ->capture_default_str();
  add_board_options(*command, i->board);
  command->add_option("--model", i->model, "pinhole or fisheye (OpenCV's)")
      ->check(CLI::IsMember({"pinhole", "fisheye"}))
      ->capture_default_str();
  command->add_option("--radial", i->options.radial, "radial coefficients of a pinhole")
      ->check(CLI::Range(0, 3))
      ->capture_default_str();
  command->add_flag("--tangential", i->options.tangential, "also tangential distortion");
  command->add_option("--lens", i->lens.lens, "lens prescription (name or file) to compare the distortion with");
  add_quantity(*command, "--focus", i->lens.focus_m, "m", "object distance of the lens (default: infinity)");
  add_quantity(*command, "--stop-diameter", i->lens.stop_diameter_mm, "mm",
               "stop diameter of the lens (default: wide open)");
  add_quantity(*command, "--pixel-pitch", i->lens.pixel_pitch_um, "um", "pixel pitch of the sensor")
      ->capture_default_str();
  add_output(*command, "-o,--output", i->output, "camera (JSON file)");
  add_output(*command, "--picture", i->picture, "coverage map (PNG)");
  command->add_flag("--json", i->json, "machine-readable output");
  add_examples(*command, {"pecs align intrinsics recording.raw --columns 8 --rows 5 -o camera.json",
                          "pecs align intrinsics *.png --columns 8 --rows 5 --lens pecs_lab_15mm --focus 0.5m"});
  command->callback([i, &console] { intrinsics(*i, console); });
}

Json found_disk(const events::Stream& recording, const std::string& file) {
  return to_json(find_disk(events::recording_of(recording, file, 0, std::numeric_limits<std::int64_t>::max()), file));
}

}  // namespace pecs::app
