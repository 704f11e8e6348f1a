#include "pecs/calibration/lab_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "pecs/error.h"

namespace pecs::calibration {

cv::Vec3d LabScene::position_mm() const {
  if (is_board()) return {values.at("start_right_mm"), values.at("board_up_mm"), values.at("board_distance_mm")};
  return {values.at("disk_right_mm"), values.at("disk_up_mm"), values.at("disk_distance_mm")};
}

BoardMotion LabScene::board() const { return {values.at("start_right_mm"), -1000 * values.at("speed_m_per_s")}; }
DiskMotion LabScene::disk() const { return {values.at("phase_deg"), 6 * values.at("rpm")}; }
double LabScene::disk_period_deg() const { return 720 / values.at("sectors"); }

void LabScene::set(const std::map<std::string, double>& found) {
  for (const auto& [key, value] : found) {
    values[key] = value;
    const Range range = ranges.contains(key) ? ranges.at(key) : Range{};
    if (value < range.min || value > range.max)
      throw bad_input(file, key, fmt::format("{:.3f} from the recording", value),
                      fmt::format("a value in [{}, {}], the scene's range", range.min, range.max));
  }
}

LabScene load_lab_scene(const std::string& folder) {
  LabScene s;
  s.file = (std::filesystem::path(folder) / "scene.json").string();
  const Json json = parse_json_file(s.file);
  s.name = std::filesystem::weakly_canonical(folder).filename().string();
  JsonObject top(json, s.file);
  JsonObject camera = top.object("camera");
  s.lens.lens = camera.text("lens");
  s.lens.focus_m = camera.maybe_number("focus_m");
  s.lens.stop_diameter_mm = camera.maybe_number("stop_diameter_mm");
  JsonObject parameters = top.object("parameters");
  for (const auto& [key, value] : json["parameters"].items()) {
    if (key.starts_with('_')) continue;
    JsonObject declared = parameters.object(key);
    if (key == "illuminance_lux" || key == "lamp_spectrum") s.light[key] = declared.any("value");
    if (!declared.any("value").is_number()) continue;
    s.values[key] = declared.number("value");
    if (!declared.has("range")) continue;
    const std::vector<double> range = declared.numbers("range");
    if (range.size() != 2) declared.fail("range", fmt::format("{} numbers", range.size()), "2");
    s.ranges[key] = {range[0], range[1]};
  }
  const auto has = [&](std::initializer_list<const char*> keys) {
    return std::all_of(keys.begin(), keys.end(), [&](const char* k) { return s.values.contains(k); });
  };
  if (!has({"speed_m_per_s", "start_right_mm", "board_up_mm", "board_distance_mm", "square_mm", "squares"}) &&
      !has({"rpm", "phase_deg", "sectors", "disk_radius_mm", "disk_distance_mm", "disk_right_mm", "disk_up_mm"}))
    throw Error(ExitCode::unsupported,
                s.file + ": parameters: got neither those of scenes/board nor of scenes/rotating_disk");
  return s;
}

void apply_aligned(LabScene& scene, const std::string& aligned_file) {
  const Json json = parse_json_file(aligned_file);
  JsonObject top(json, aligned_file);
  top.integer_or("pecs_aligned", 1, 1, 1);
  if (top.text("scene") != scene.name) top.fail("scene", top.text("scene"), scene.name);
  JsonObject camera = top.object("camera");
  const auto r = camera.numbers("rotation_deg", {-360, 360});
  if (r.size() != 3) camera.fail("rotation_deg", fmt::format("{} numbers", r.size()), "3");
  scene.rotation_deg = {r[0], r[1], r[2]};
  JsonObject parameters = top.object("parameters");
  for (const auto& [key, value] : json["parameters"].items()) {
    if (!scene.values.contains(key)) parameters.fail(key, "a parameter that the scene lacks", "one of its own");
    scene.values[key] = parameters.number(key, scene.ranges[key]);
  }
}

}  // namespace pecs::calibration
