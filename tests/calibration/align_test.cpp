#include "pecs/calibration/align.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <opencv2/calib3d.hpp>
#include <random>

#include "pecs/error.h"
#include "pecs/sensor/sensor.h"

namespace pecs::calibration {
namespace {

const std::string kScenes = std::string(PECS_SOURCE_DIR) + "/scenes/";
constexpr double kDegree = CV_PI / 180;

// A camera rotated from Blender's (90, 0, 0): the reference for the rotation that align_scene writes.
struct CameraPose {
  cv::Vec3d rotation_deg;
  cv::Matx33d camera_from_world() const {
    const auto about = [](int axis, double deg) {
      cv::Vec3d v(0, 0, 0);
      v[axis] = deg * kDegree;
      cv::Matx33d r;
      cv::Rodrigues(v, r);
      return r;
    };
    const cv::Matx33d blender =
        about(2, rotation_deg[2]) * about(1, rotation_deg[1]) * about(0, rotation_deg[0]);  // world from Blender
    return cv::Matx33d(1, 0, 0, 0, -1, 0, 0, 0, -1) * blender.t();
  }
};

// Events of the disk of scenes/rotating_disk in front of a rotated camera, drawn from its geometry behind their edge.
events::Recording disk_recording(const Optics& optics, const CameraPose& camera, const std::map<std::string, double>& p,
                                 cv::Size size) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> unit(0, 1);
  constexpr double kSpan_us = 60'000;
  const cv::Matx33d turn = camera.camera_from_world();
  std::vector<events::Event> events;
  while (events.size() < 60'000) {
    const double t_us = unit(random) * kSpan_us, r = p.at("disk_radius_mm") * std::sqrt(unit(random));
    const int edge = static_cast<int>(unit(random) * 4);
    const double behind = -1.5 * std::log(1 - unit(random));
    if (behind > 90) continue;
    const double a = (p.at("phase_deg") + 90 * edge + 6 * p.at("rpm") * t_us * 1e-6 - behind) * kDegree;
    const cv::Point2d q =
        optics.project(cv::Point3d(turn * cv::Vec3d(p.at("disk_right_mm") + r * std::cos(a), p.at("disk_distance_mm"),
                                                    p.at("disk_up_mm") + r * std::sin(a))));
    if (!q.inside(cv::Rect2d(0, 0, size.width, size.height))) continue;
    events.push_back({static_cast<std::int64_t>(t_us), static_cast<std::uint16_t>(q.x), static_cast<std::uint16_t>(q.y),
                      edge % 2 == 0});
  }
  events.push_back({0, 0, 0, 0}), events.push_back({static_cast<std::int64_t>(kSpan_us), 0, 0, 0});
  return events::recording_of({{size.width, size.height, ""}, std::move(events)}, "x.raw", 0, INT64_MAX);
}

TEST(Align, DiskAndRotatedCamera) {
  const LabScene scene = load_lab_scene(kScenes + "rotating_disk");
  const cv::Size size(1280, 720);
  const Optics optics = optics_of(scene.lens, size);
  const CameraPose camera{{91.5, 0, 3}};
  auto truth = scene.values;
  truth["disk_right_mm"] = 60, truth["disk_up_mm"] = 35, truth["disk_distance_mm"] = 1500, truth["phase_deg"] = 40,
  truth["rpm"] = 355;
  const TargetEstimate found =
      find_in_recording(disk_recording(optics, camera, truth, size), scene, optics, {}, "x.raw");
  const Aligned aligned = align_scene(scene, found, ClockModel::file);
  const auto& v = aligned.scene.values;
  EXPECT_NEAR(v.at("rpm"), 355, 0.4);
  EXPECT_LT(std::abs(std::remainder(v.at("phase_deg") - 40, 180)), 0.7);  // bias of the search
  EXPECT_NEAR(v.at("disk_distance_mm"), 1500, 8);
  // The position of the disk in the picture is far more certain than the camera's rotation.
  const auto centre = [&](const cv::Vec3d& rotation, const std::map<std::string, double>& p) {
    return optics.project(cv::Point3d(CameraPose{rotation}.camera_from_world() *
                                      cv::Vec3d(p.at("disk_right_mm"), p.at("disk_distance_mm"), p.at("disk_up_mm"))));
  };
  EXPECT_LT(cv::norm(centre(aligned.scene.rotation_deg, v) - centre(camera.rotation_deg, truth)), 0.3);
  EXPECT_NEAR(aligned.scene.rotation_deg[0], 91.5, 1);
  EXPECT_NEAR(aligned.scene.rotation_deg[2], 3, 1);

  // Estimating the clock instead of phase and speed gives the same angles at the same file times.
  const Aligned by_clock = align_scene(scene, found, ClockModel::offset_and_rate);
  EXPECT_EQ(by_clock.scene.values.at("rpm"), scene.values.at("rpm"));
  for (const double file_us : {0.0, 50'000.0}) {
    const double t_s = by_clock.clock_rate * (file_us - by_clock.clock_offset_us) * 1e-6;
    const double angle = scene.values.at("phase_deg") + 6 * scene.values.at("rpm") * t_s;
    EXPECT_LT(std::abs(std::remainder(angle - 40 - 6 * 355 * file_us * 1e-6, 180)), 0.7);
  }
}

// A simulated board, perpendicular to the optical axis, so that all its points have the same displacement.
TEST(Align, BoardAndCorrectionByASimulation) {
  LabScene scene = load_lab_scene(kScenes + "board");
  const cv::Size size(320, 180);
  scene.lens.pixel_pitch_um = 19.44;
  const Optics optics = optics_of(scene.lens, size);
  const auto recorded = [&](double start_mm, double speed, double up_mm, double distance_mm, int stops_ms = 160,
                            bool turns_back = false) {
    sensor::Sensor sensor(sensor::load_chip("imx636"), 320, 180, 1, 10'000, {}, {.readout = true});  // 10 pA
    sensor::LabelledEvents out;
    std::vector<float> frame(std::size_t{320} * 180);
    std::vector<cv::Point2d> mm;  // of each pixel in the plane of the board
    for (int y = 0; y < 180; ++y)
      for (int x = 0; x < 320; ++x) mm.push_back(optics.normalised({x + 0.5, y + 0.5}) * distance_mm);
    const double square = 41.7, soft = 0.8 * distance_mm / optics.focal_px();
    for (int i = 0; i <= 160; ++i) {
      const double at = start_mm - speed * (i < stops_ms ? i : turns_back ? 2 * stops_ms - i : stops_ms);  // 1 ms apart
      for (std::size_t k = 0; k < mm.size(); ++k) {
        const double u = (mm[k].x - at) / square + 2, v = (mm[k].y + up_mm) / square + 2;
        const auto wave = [&](double w) {
          return (std::lround(w) % 2 ? -1 : 1) * std::clamp((w - std::round(w)) * square / soft, -1.0, 1.0);
        };
        const bool inside = u > 0 && v > 0 && u < 4 && v < 4;
        frame[k] = static_cast<float>(inside ? 0.455 + 0.385 * wave(u) * wave(v) : 0.84);
      }
      const float* planes[] = {frame.data()};
      const double t_us[] = {i * 1000.0};
      sensor.push(planes, t_us, i == 160, out);
    }
    return events::recording_of({{320, 180, ""}, {out.events.begin(), out.events.end()}}, "x.raw", 0, INT64_MAX);
  };
  const events::Recording recording = recorded(60, 0.8, 12, 1500);
  const TargetEstimate real = find_in_recording(recording, scene, optics, {.views = 6, .hold_camera = true}, "x.raw");
  const Aligned first = align_scene(scene, real, ClockModel::file);
  const auto& a = first.scene.values;
  EXPECT_NEAR(a.at("speed_m_per_s"), 0.8, 0.004);
  EXPECT_NEAR(a.at("start_right_mm"), 60, 1.5);
  EXPECT_NEAR(a.at("board_distance_mm"), 1500, 10);
  EXPECT_LT(real.residual["rms_px"], 0.3);
  EXPECT_EQ(text_of(first.json["not_estimated"]), R"({"illuminance_lux":100,"lamp_spectrum":"led_b3"})");

  // A wrong distance (or square) gives a warning; a wrong count and a reversal are errors.
  LabScene nearer = scene;
  nearer.values["board_distance_mm"] = 1300;
  const Json warnings = align_scene(nearer, real, ClockModel::file).json["warnings"];
  ASSERT_FALSE(warnings.empty());
  EXPECT_NE(warnings.back().get<std::string>().find("check square_mm (36.1"), std::string::npos) << warnings;
  LabScene more = scene;
  more.values["squares"] = 6;
  EXPECT_THROW(find_in_recording(recording, more, optics, {.views = 3}, "x.raw"), Error);
  try {
    find_in_recording(recorded(60, 0.8, 12, 1500, 80, true), scene, optics, {.views = 6}, "x.raw");
    FAIL() << "a board that turns back";
  } catch (const Error& e) {
    EXPECT_NE(std::string(e.what()).find("does not slide uniformly"), std::string::npos) << e.what();
  }

  // A board that stops, and one that is partly out of view at first, are measured where possible, with warnings.
  for (const events::Recording& part : {recorded(60, 0.8, 12, 1500, 100), recorded(300, 0.8, 12, 1500)}) {
    const TargetEstimate found = find_in_recording(part, scene, optics, {.views = 6, .hold_camera = true}, "x.raw");
    EXPECT_NEAR(std::get<BoardMotion>(found.motion).per_s, -800, 8);
    ASSERT_FALSE(found.warnings.empty());
    EXPECT_NE(found.warnings[0].find("no board at t = "), std::string::npos) << found.warnings[0];
  }
  EXPECT_THROW(find_in_recording(recorded(430, 0.8, 12, 1500), scene, optics, {.views = 6}, "x.raw"), Error);

  // The simulation of another start, with its errors, gives the true start.
  LabScene other = scene;
  other.values["start_right_mm"] = 70, other.values["speed_m_per_s"] = 0.8, other.values["board_up_mm"] = 8;
  other.values["board_distance_mm"] = 1520;
  const TargetEstimate sim =
      find_in_recording(recorded(70, 0.8, 8, 1520), other, optics, {.views = 6, .hold_camera = true}, "x.raw");
  const Aligned second = align_scene(other, real, sim, ClockModel::offset);
  EXPECT_NEAR(second.scene.values.at("speed_m_per_s"), 0.8, 0.004);
  // 60 - 800 t = 70 - 800 (t - offset)
  EXPECT_NEAR(second.clock_offset_us, (70.0 - 60.0) / -0.8 * 1000, 300);
}

TEST(Align, ErrorsOfASceneFileNameThePlace) {
  const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "pecs_wrong_scene";
  std::filesystem::create_directories(folder);
  const auto line = [&](const std::string& parameters) {
    std::ofstream(folder / "scene.json") << R"({"camera": {"lens": "pecs_lab_15mm"})" << parameters << "}";
    try {
      load_lab_scene(folder.string());
    } catch (const Error& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  EXPECT_NE(line("").find("parameters: got nothing"), std::string::npos);
  EXPECT_NE(line(R"(, "parameters": [1])").find("parameters: got [1], wanted an object"), std::string::npos);
  EXPECT_NE(line(R"(, "parameters": {"rpm": 3})").find("parameters.rpm: got 3, wanted an object"), std::string::npos);
  EXPECT_NE(line(R"(, "parameters": {"rpm": {"value": 1, "range": [0]}})").find("rpm.range: got 1 numbers"),
            std::string::npos);
  std::filesystem::remove_all(folder);
}

TEST(Align, AnUnknownSceneIsUnsupported) {
  EXPECT_THROW(load_lab_scene(kScenes + "room"), Error);
  LabScene board = load_lab_scene(kScenes + "board");
  const auto path = std::filesystem::temp_directory_path() / "pecs_align_test.json";
  std::ofstream(path)
      << R"({"pecs_aligned": 1, "scene": "rotating_disk", "camera": {"rotation_deg": [90, 0, 0]}, "parameters": {}})";
  EXPECT_THROW(apply_aligned(board, path.string()), Error);
  std::ofstream(path)
      << R"({"pecs_aligned": 2, "scene": "board", "camera": {"rotation_deg": [91, 0, 2]}, "parameters": {}})";
  EXPECT_THROW(apply_aligned(board, path.string()), Error);
  std::ofstream(path)
      << R"({"pecs_aligned": 1, "scene": "board", "camera": {"rotation_deg": [91, 0, 2]}, "parameters": {"board_up_mm": 7}})";
  apply_aligned(board, path.string());
  EXPECT_EQ(board.values.at("board_up_mm"), 7);
  EXPECT_EQ(board.rotation_deg, cv::Vec3d(91, 0, 2));
  std::filesystem::remove(path);
}

}  // namespace
}  // namespace pecs::calibration
