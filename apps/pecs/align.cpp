// pecs align: what stands before the camera, measured in a recording.
#include <fmt/format.h>

#include <memory>
#include <opencv2/imgcodecs.hpp>

#include "commands.h"
#include "pecs/calibration/disk.h"
#include "pecs/files.h"
#include "pecs/run_record.h"

namespace pecs::app {
namespace {

struct Arguments {
  std::string events, output;
  bool json = false;
};

void detect(const Arguments& a) {
  const auto shown = calibration::shown_of(events::read_all(a.events), a.events, 0, INT64_MAX);
  const calibration::Disk disk = calibration::find_disk(shown, a.events);
  const Json json = calibration::to_json(disk);
  if (!a.output.empty()) {
    std::vector<std::uint8_t> png;
    cv::imencode(".png", calibration::disk_picture(shown, disk, calibration::kLight), png);
    AtomicFile file(a.output);
    file.write(std::as_bytes(std::span(png)));
    file.commit();
    write_run_record(a.output, {"align detect", arguments(), Json::object(), {a.events}, json});
  }
  for (const auto& warning : disk.warnings) fmt::print(stderr, "pecs: warning: {}\n", warning);
  if (a.json) {
    fmt::print("{}\n", json.dump(2));
    return;
  }
  const auto line = [](const char* name, const calibration::Measured& m, const char* unit) {
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

}  // namespace

void add_align(CLI::App& app) {
  auto* align = app.add_subcommand("align", "Measures the scene in a recording (docs/align.md)");
  align->require_subcommand(1);
  auto a = std::make_shared<Arguments>();
  auto* command = align->add_subcommand("detect", "Finds a turning disk: centre, rim, speed, phase, sectors");
  command->add_option("EVENTS", a->events, "Recording, any event format")->required();
  command->add_option("-o,--output", a->output, "Picture of what was found (PNG)");
  command->add_flag("--json", a->json, "Machine-readable output");
  command->callback([a] { detect(*a); });
}

}  // namespace pecs::app
