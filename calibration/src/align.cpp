#include "pecs/calibration/align.h"

#include <ceres/ceres.h>
#include <ceres/cubic_interpolation.h>
#include <ceres/rotation.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "pecs/error.h"

namespace pecs::calibration {
namespace {

constexpr double kDegree = CV_PI / 180;

// ---- cameras --------------------------------------------------------------------------------------------------------

// World (x right, y forward, z up) to the axes of a camera that looks along +y.
const cv::Matx33d kCameraFromWorld(1, 0, 0, 0, 0, -1, 0, 1, 0);
const cv::Matx33d kBlenderFromCamera(1, 0, 0, 0, -1, 0, 0, 0, -1);

cv::Matx33d matrix_of(const cv::Vec3d& turn) {
  cv::Matx33d r;
  cv::Rodrigues(turn, r);
  return r;
}

cv::Vec3d turn_of(const cv::Matx33d& r) {
  cv::Vec3d turn;
  cv::Rodrigues(r, turn);
  return turn;
}

// Euler XYZ (R = Rz Ry Rx) of Blender's camera object.
cv::Vec3d blender_rotation_deg(const cv::Vec3d& turn) {
  const cv::Matx33d r = (matrix_of(turn) * kCameraFromWorld).t() * kBlenderFromCamera;  // world from Blender's camera
  return cv::Vec3d(std::atan2(r(2, 1), r(2, 2)), std::asin(std::clamp(-r(2, 0), -1.0, 1.0)),
                   std::atan2(r(1, 0), r(0, 0))) /
         kDegree;
}

cv::Vec3d turn_from_blender(const cv::Vec3d& rotation_deg) {
  const auto about = [](int axis, double deg) {
    cv::Vec3d v(0, 0, 0);
    v[axis] = deg * kDegree;
    return matrix_of(v);
  };
  const cv::Matx33d r = about(2, rotation_deg[2]) * about(1, rotation_deg[1]) * about(0, rotation_deg[0]);
  return turn_of((r * kBlenderFromCamera).t() * kCameraFromWorld.t());
}

// A point given to the right, down and forward of the unturned camera.
cv::Point2d seen(const Optics& optics, const cv::Matx33d& turn, double right, double down, double forward) {
  return optics.project(cv::Point3d(turn * cv::Vec3d(right, down, forward)));
}

// ---- board ----------------------------------------------------------------------------------------------------------

// Measured corner against the board at (right + speed t, up, distance), all turned by the camera. Drift: of the motion
// off the board's rows, up and forward.
struct CornerError {
  const ceres::CubicInterpolator<ceres::Grid1D<double>>& radius;
  const Optics& optics;
  cv::Point3d on_board;
  cv::Point2d pixel;
  double t_s, deviation_px;

  template <class T>
  bool operator()(const T* turn, const T* place, const T* speed, const T* drift, T* error) const {
    const T world[3] = {place[0] + speed[0] * t_s + on_board.x, -(place[1] + drift[0] * t_s) + on_board.y,
                        place[2] + drift[1] * t_s};
    T p[3];
    ceres::AngleAxisRotatePoint(turn, world, p);
    const T across = sqrt(p[0] * p[0] + p[1] * p[1] + 1e-12);
    T r;
    radius.Evaluate(atan2(across, p[2]) / optics.step_rad, &r);
    error[0] = (optics.axis_px.x + p[0] * r / across - pixel.x) / deviation_px;
    error[1] = (optics.axis_px.y + p[1] * r / across - pixel.y) / deviation_px;
    return true;
  }
};

struct BoardPose {
  std::array<double, 3> turn{}, place{};  // place: right, up, distance at time_us [mm]
  double speed = 0;                       // to the right, mm/s
  std::array<double, 2> drift{};
};

double rms(const std::vector<double>& v) {
  double squares = 0;
  for (const double x : v) squares += x * x;
  return v.empty() ? 0 : std::sqrt(squares / static_cast<double>(v.size()));
}

Found find_board(const events::Recording& recording, const LabScene& scene, const Optics& optics, const Search& how,
                 const std::string& file) {
  const int inner = static_cast<int>(scene.values.at("squares")) - 1;
  if (inner < 3)
    throw Error(ExitCode::unsupported, fmt::format("{}: squares: got {}, wanted at least 4", scene.file, inner + 1));
  const BoardShape shape{Pattern::checkerboard, inner, inner, scene.values.at("square_mm")};
  BoardSearch search = find_boards(recording, shape, how.views, file);
  if (search.views.size() < 3)
    throw bad_input(file, "board", fmt::format("the board at {} instants", search.views.size()), "at 3 or more");
  Found found;
  found.time_us = static_cast<double>(recording.first_us) + 0.5 * static_cast<double>(recording.span_us);
  const auto seconds = [&](const BoardView& v) { return (v.t_us - found.time_us) * 1e-6; };
  const auto board = shape.points_mm();

  // First guess: the pose in the middle view, and where the others are seen from there.
  BoardPose pose;
  std::vector<double> t, right;
  cv::Matx33d turn = matrix_of(turn_from_blender(scene.rotation_deg));
  for (std::size_t k = 0; k < search.views.size(); ++k) {
    const auto& v = search.views[(k + search.views.size() / 2) % search.views.size()];
    std::vector<cv::Point2d> flat;
    for (const auto& p : v.points) flat.push_back(optics.normalised(p));
    cv::Vec3d r, at;
    cv::solvePnP(board, flat, cv::Matx33d::eye(), cv::noArray(), r, at, false, cv::SOLVEPNP_IPPE);
    if (k == 0) {
      if (how.hold_camera) r = turn_of(turn);
      turn = matrix_of(r);
      const cv::Vec3d p = turn.t() * at;
      pose.place = {p[0], -p[1], p[2]};
      std::copy_n(r.val, 3, pose.turn.begin());
    }
    t.push_back(seconds(v)), right.push_back((turn.t() * at)[0]);
  }
  double mean_t = 0, mean_r = 0, tt = 0, tr = 0;
  for (std::size_t k = 0; k < t.size(); ++k) mean_t += t[k] / double(t.size()), mean_r += right[k] / double(t.size());
  for (std::size_t k = 0; k < t.size(); ++k) tt += (t[k] - mean_t) * (t[k] - mean_t), tr += (t[k] - mean_t) * right[k];
  pose.speed = tr / tt;
  pose.place[0] = mean_r - pose.speed * mean_t;

  // All views together, with a loss that forgives outliers.
  const ceres::Grid1D<double> grid(optics.radius_px.data(), 0, static_cast<int>(optics.radius_px.size()));
  const ceres::CubicInterpolator<ceres::Grid1D<double>> radius(grid);
  ceres::Problem problem;
  std::vector<ceres::ResidualBlockId> blocks;
  for (const auto& v : search.views)
    for (std::size_t i = 0; i < board.size(); ++i)
      blocks.push_back(problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<CornerError, 2, 3, 3, 1, 2>(
              new CornerError{radius, optics, board[i], v.points[i], seconds(v), std::hypot(v.deviation_px, 0.05)}),
          new ceres::HuberLoss(2), pose.turn.data(), pose.place.data(), &pose.speed, pose.drift.data()));
  problem.SetParameterBlockConstant(pose.drift.data());
  if (how.hold_camera) problem.SetParameterBlockConstant(pose.turn.data());
  ceres::Solver::Options options;
  options.logging_type = ceres::SILENT;
  options.max_num_iterations = 100;
  options.function_tolerance = 1e-10;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);

  // What is left, in px, by view.
  std::vector<double> all, scaled;
  std::vector<cv::Point2d> predicted, measured;
  std::vector<std::string> off;
  Json view_rms = Json::array();
  const cv::Vec3d axis(pose.turn.data());
  const cv::Matx33d r = matrix_of(axis);
  for (const auto& v : search.views) {
    std::vector<double> view;
    for (std::size_t i = 0; i < board.size(); ++i) {
      const cv::Point2d p = seen(optics, r, pose.place[0] + pose.speed * seconds(v) + board[i].x,
                                 -pose.place[1] + board[i].y, pose.place[2]);
      const cv::Point2d d = v.points[i] - p;
      predicted.push_back(p), measured.push_back(v.points[i]);
      for (const double x : {d.x, d.y})
        view.push_back(x), all.push_back(x), scaled.push_back(x / std::hypot(v.deviation_px, 0.05));
    }
    view_rms.push_back(rms(view));
    if (rms(view) > 1)
      off.push_back(
          fmt::format("the board at t = {:.0f} us lies {:.1f} px (rms) off a uniform motion", v.t_us, rms(view)));
  }
  if (3 * off.size() > search.views.size())
    throw bad_input(file, "motion",
                    fmt::format("a board that does not slide uniformly ({} of {} views; {})", off.size(),
                                search.views.size(), off[0]),
                    "one speed along its rows; cut the recording where it stops or turns back");
  found.warnings = off;
  for (const auto& line : search.missed) found.warnings.push_back("no board at " + line);

  ceres::Covariance::Options c;
  c.algorithm_type = ceres::DENSE_SVD;
  ceres::Covariance covariance(c);
  const std::vector<std::pair<const double*, const double*>> wanted = {
      {pose.turn.data(), pose.turn.data()}, {pose.place.data(), pose.place.data()}, {&pose.speed, &pose.speed}};
  if (covariance.Compute(wanted, &problem)) {
    std::array<double, 9> turn_c, place_c;
    double speed_c = 0;
    covariance.GetCovarianceBlock(pose.turn.data(), pose.turn.data(), turn_c.data());
    covariance.GetCovarianceBlock(pose.place.data(), pose.place.data(), place_c.data());
    covariance.GetCovarianceBlock(&pose.speed, &pose.speed, &speed_c);
    const double scale = std::max(1.0, rms(scaled));
    const char* turns[] = {"turn_x_deg", "turn_y_deg", "turn_z_deg"};
    const char* places[] = {"start_right_mm", "board_up_mm", "board_distance_mm"};
    for (std::size_t i = 0; i < 3; ++i) {
      found.deviation[turns[i]] = scale * std::sqrt(turn_c[4 * i]) / kDegree;
      found.deviation[places[i]] = scale * std::sqrt(place_c[4 * i]);
    }
    found.deviation["speed_m_per_s"] = scale * std::sqrt(speed_c) * 1e-3;
  }
  found.turn = axis;
  found.right_mm = found.along = pose.place[0], found.up_mm = pose.place[1], found.distance_mm = pose.place[2];
  found.rate = pose.speed;

  // The motion off the board's rows, and a homography over what is left: reported, not applied.
  problem.SetParameterBlockVariable(pose.drift.data());
  ceres::Solve(options, &problem, &summary);
  const double tilt = std::hypot(pose.drift[0], pose.drift[1]) / std::max(1e-9, std::abs(pose.speed)) / kDegree;
  std::vector<double> warped;
  Json warp = nullptr;
  if (const cv::Mat h = cv::findHomography(predicted, measured); !h.empty()) {
    std::vector<cv::Point2d> q;
    cv::perspectiveTransform(predicted, q, h);
    for (std::size_t i = 0; i < q.size(); ++i)
      for (const double x : {measured[i].x - q[i].x, measured[i].y - q[i].y}) warped.push_back(x);
    warp = {{"matrix", std::vector<double>(h.begin<double>(), h.end<double>())}, {"rms_px", rms(warped)}};
  }
  found.residual = {
      {"rms_px", rms(all)}, {"view_rms_px", view_rms}, {"motion_off_rows_deg", tilt}, {"homography", warp}};
  if (tilt > 2)
    found.warnings.push_back(
        fmt::format("the board moves {:.1f} deg off its rows; the scene moves it along them", tilt));
  found.views = std::move(search.views);
  return found;
}

// ---- disk -----------------------------------------------------------------------------------------------------------

struct DiskPose {
  std::array<double, 5> p{};  // turn about x and y [rad], right, up, distance [mm]
  cv::Matx33d base;           // the scene's turn, before that one
  cv::Matx33d turn() const { return matrix_of({p[0], p[1], 0}) * base; }
};

// The plane of the disk as a camera square to it sees it from the distance `scale_mm` belongs to.
struct Plane {
  const Optics& optics;
  DiskPose pose;
  double px_per_mm;
  cv::Matx33d turn = pose.turn();

  cv::Point2d of(const cv::Point2d& pixel) const {
    const cv::Point2d n = optics.normalised(pixel);
    const cv::Vec3d d = turn.t() * cv::Vec3d(n.x, n.y, 1);
    return optics.axis_px + cv::Point2d(d[0], d[1]) * (pose.p[4] / d[2] * px_per_mm);
  }
  cv::Point2d pixel(const cv::Point2d& on_plane) const {
    const cv::Point2d mm = (on_plane - optics.axis_px) / px_per_mm;
    return seen(optics, turn, mm.x, mm.y, pose.p[4]);
  }
};

// Rim and centre of the scene's disk under a pose, in the plane of an earlier one, against those measured there.
struct DiskError {
  const Plane& plane;
  const Disk& disk;
  double radius_mm;
  static constexpr int kRim = 36;

  bool operator()(const double* p, double* error) const {
    DiskPose pose = plane.pose;
    std::copy_n(p, 5, pose.p.begin());
    const cv::Matx33d turn = pose.turn();
    const auto place = [&](double u, double v) {
      return plane.of(seen(plane.optics, turn, pose.p[2] + u, -pose.p[3] + v, pose.p[4]));
    };
    const cv::Point2d centre = place(0, 0);
    error[0] = (centre.x - disk.centre_x.value) / std::hypot(disk.centre_x.deviation, 0.02);
    error[1] = (centre.y - disk.centre_y.value) / std::hypot(disk.centre_y.deviation, 0.02);
    const double a = disk.rim.angle * kDegree, half_a = disk.rim.size.width / 2, half_b = disk.rim.size.height / 2;
    for (int i = 0; i < kRim; ++i) {
      const double angle = 2 * CV_PI * i / kRim;
      const cv::Point2d q =
          place(radius_mm * std::cos(angle), radius_mm * std::sin(angle)) - cv::Point2d(disk.rim.center);
      const double u = (q.x * std::cos(a) + q.y * std::sin(a)) / half_a,
                   v = (-q.x * std::sin(a) + q.y * std::cos(a)) / half_b;
      error[2 + i] = (std::hypot(u, v) - 1) * (half_a + half_b) / 2 / std::max(0.05, disk.rim_rms_px) * 0.6;
    }
    return true;
  }
};

Found find_turning_disk(const events::Recording& recording, const LabScene& scene, const Optics& optics,
                        const Search& how, const std::string& file) {
  const double radius_mm = scene.values.at("disk_radius_mm");
  Found found;
  found.time_us = static_cast<double>(recording.first_us + recording.span_us / 2);
  Plane plane{
      optics, {{0, 0, 0, 0, scene.values.at("disk_distance_mm")}, matrix_of(turn_from_blender(scene.rotation_deg))}, 0};
  plane.px_per_mm = optics.focal_px() / plane.pose.p[4];
  Disk disk;
  std::map<std::string, double> deviation;
  constexpr int kPasses = 3;
  for (int pass = 0; pass < kPasses; ++pass) {
    disk = find_disk(recording, file, [&](const cv::Point2d& p) { return plane.of(p); });
    if (disk.rim.size.width <= 0)
      throw bad_input(file, "disk", "a disk whose rim is out of sight", "its rim, which says how far it is");
    if (pass + 1 == kPasses) break;  // the last look is through the final pose
    DiskPose next = plane.pose;
    if (pass == 0) {
      const double radius = (disk.rim.size.width + disk.rim.size.height) / 4;
      next.p[4] = plane.pose.p[4] * radius_mm * plane.px_per_mm / radius;
      next.p[2] = (disk.centre_x.value - optics.axis_px.x) / plane.px_per_mm * next.p[4] / plane.pose.p[4];
      next.p[3] = -(disk.centre_y.value - optics.axis_px.y) / plane.px_per_mm * next.p[4] / plane.pose.p[4];
    }
    ceres::Problem problem;
    problem.AddResidualBlock(new ceres::NumericDiffCostFunction<DiskError, ceres::CENTRAL, DiskError::kRim + 2, 5>(
                                 new DiskError{plane, disk, radius_mm}),
                             nullptr, next.p.data());
    if (how.hold_camera) problem.SetManifold(next.p.data(), new ceres::SubsetManifold(5, {0, 1}));
    ceres::Solver::Options options;
    options.logging_type = ceres::SILENT;
    options.max_num_iterations = 100;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    ceres::Covariance::Options c;
    c.algorithm_type = ceres::DENSE_SVD;
    ceres::Covariance covariance(c);
    const std::vector<std::pair<const double*, const double*>> wanted = {{next.p.data(), next.p.data()}};
    if (covariance.Compute(wanted, &problem)) {
      std::array<double, 25> v;
      covariance.GetCovarianceBlock(next.p.data(), next.p.data(), v.data());
      const char* names[] = {"turn_x_deg", "turn_y_deg", "disk_right_mm", "disk_up_mm", "disk_distance_mm"};
      for (std::size_t i = 0; i < 5; ++i) deviation[names[i]] = std::sqrt(v[6 * i]) / (i < 2 ? kDegree : 1);
    }
    plane.pose = next, plane.turn = next.turn();
  }
  const double sectors = disk.sectors;
  if (disk.sectors != static_cast<int>(scene.values.at("sectors")))
    throw bad_input(file, "disk", fmt::format("a disk of {} sectors", disk.sectors),
                    fmt::format("{:.0f}, as the scene has", scene.values.at("sectors")));
  found.turn = turn_of(plane.pose.turn());
  found.right_mm = plane.pose.p[2], found.up_mm = plane.pose.p[3], found.distance_mm = plane.pose.p[4];
  // A white sector's edge that leads when the disk turns counter-clockwise; the other way round it trails and darkens.
  found.along = (disk.speed_deg_s.value > 0 ? disk.on_edge_deg : disk.off_edge_deg).value,
  found.rate = disk.speed_deg_s.value;
  found.deviation = deviation;
  found.deviation["phase_deg"] =
      std::hypot(disk.on_edge_deg.deviation, disk.speed_deg_s.deviation * found.time_us * 1e-6);
  found.deviation["rpm"] = disk.speed_deg_s.deviation / 6;
  found.warnings = disk.warnings;
  const cv::Point2d centre = plane.pixel({disk.centre_x.value, disk.centre_y.value});
  found.residual = {
      {"centre_px", {centre.x, centre.y}},
      {"rim_off_centre_px",
       std::hypot(disk.rim.center.x - disk.centre_x.value, disk.rim.center.y - disk.centre_y.value)},
      {"rim_radius_off_px", (disk.rim.size.width + disk.rim.size.height) / 4 - radius_mm * plane.px_per_mm},
      {"rim_axes_difference_px", std::abs(disk.rim.size.width - disk.rim.size.height) / 2},
      {"rim_rms_px", disk.rim_rms_px},
      {"opposite_edges_off_deg",
       std::remainder(disk.off_edge_deg.value - disk.on_edge_deg.value - 360 / sectors, 720 / sectors)}};
  return found;
}

// ---- scene ----------------------------------------------------------------------------------------------------------

// Where the scene itself puts what Found measures, at scene time 0.
struct Line {
  double along, rate;
};
Line line_of(const LabScene& s) {
  if (s.is_board()) return {s.values.at("start_right_mm"), -1000 * s.values.at("speed_m_per_s")};
  return {s.values.at("phase_deg"), 6 * s.values.at("rpm")};
}

Aligned finished(const LabScene& scene, const Found& real, const cv::Vec3d& turn, const cv::Vec3d& place, Line at_zero,
                 Clock clock, const char* how) {
  Aligned out;
  out.scene = scene;
  out.scene.rotation_deg = blender_rotation_deg(turn);
  auto& v = out.scene.values;
  std::vector<std::string> warnings = real.warnings;
  const Line own = line_of(scene);
  const bool board = scene.is_board();
  const double period = board ? 0 : 720 / scene.values.at("sectors");
  if (clock != Clock::file) {
    // along(file time) = the scene's along(rate (file time - offset))
    const double rate = clock == Clock::offset_and_rate ? own.rate : at_zero.rate;
    if (rate == 0 || at_zero.rate == 0)
      throw bad_input(scene.file, "speed", "0", "a target that moves, to find the clock");
    double lag = own.along - at_zero.along;
    if (period > 0) lag = std::remainder(lag, period);
    out.clock_offset_us = lag / at_zero.rate * 1e6;
    out.clock_rate = at_zero.rate / rate;
    at_zero = {own.along, rate};
  }
  std::map<std::string, double> found;
  if (board)
    found = {{"start_right_mm", at_zero.along},
             {"board_up_mm", place[1]},
             {"board_distance_mm", place[2]},
             {"speed_m_per_s", -at_zero.rate / 1000}};
  else
    found = {{"phase_deg", at_zero.along - period * std::floor(at_zero.along / period)},
             {"disk_right_mm", place[0]},
             {"disk_up_mm", place[1]},
             {"disk_distance_mm", place[2]},
             {"rpm", at_zero.rate / 6}};
  for (const auto& [key, value] : found) {
    v[key] = value;
    const Range range = scene.ranges.contains(key) ? scene.ranges.at(key) : Range{};
    if (value < range.min || value > range.max)
      throw bad_input(scene.file, key, fmt::format("{:.3f} from the recording", value),
                      fmt::format("a value in [{}, {}], the scene's range", range.min, range.max));
  }
  const char* distance = board ? "board_distance_mm" : "disk_distance_mm";
  const double ratio = v[distance] / scene.values.at(distance);
  if (std::abs(ratio - 1) > 0.05)
    warnings.push_back(
        fmt::format("the target is {:.0f} mm away, the scene says {:.0f}: a wrong {} ({:.2f} mm would agree)?",
                    v[distance], scene.values.at(distance), board ? "square_mm" : "disk_radius_mm",
                    scene.values.at(board ? "square_mm" : "disk_radius_mm") / ratio));
  const cv::Vec3d r = out.scene.rotation_deg;
  out.json = {{"pecs_aligned", 1},
              {"scene", scene.name},
              {"camera", {{"rotation_deg", {r[0], r[1], r[2]}}}},
              {"parameters", found},
              {"clock", {{"offset_us", out.clock_offset_us}, {"rate", out.clock_rate}}},
              {"deviation", real.deviation},
              {"residual", real.residual},
              {"how", how},
              {"warnings", warnings}};
  return out;
}

}  // namespace

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

Found find_in_recording(const events::Recording& recording, const LabScene& scene, const Optics& optics,
                        const Search& search, const std::string& file) {
  return scene.is_board() ? find_board(recording, scene, optics, search, file)
                          : find_turning_disk(recording, scene, optics, search, file);
}

Aligned align_scene(const LabScene& scene, const Found& real, Clock clock) {
  const Line line{real.along - real.rate * real.time_us * 1e-6, real.rate};
  return finished(scene, real, real.turn, {real.right_mm, real.up_mm, real.distance_mm}, line, clock, "measured");
}

Aligned align_scene(const LabScene& scene, const Found& real, const Found& sim, Clock clock) {
  const Line own = line_of(scene);
  const auto& v = scene.values;
  const bool board = scene.is_board();
  const double t_s = real.time_us * 1e-6, sim_s = sim.time_us * 1e-6;
  const double period = board ? 0 : 720 / v.at("sectors");
  Line line{0, real.rate * (own.rate != 0 ? own.rate / sim.rate : 1)};
  const cv::Matx33d own_turn = matrix_of(turn_from_blender(scene.rotation_deg));
  const cv::Matx33d turn = matrix_of(real.turn) * matrix_of(sim.turn).t() * own_turn;
  const double distance = real.distance_mm - sim.distance_mm + v.at(board ? "board_distance_mm" : "disk_distance_mm");

  // The middle of the target is corrected where it is seen: turn and place exchange, each alone is known far worse.
  const auto seen_at = [](const cv::Matx33d& r, double right, double up, double forward) {
    const cv::Vec3d p = r * cv::Vec3d(right, -up, forward);
    return p / p[2];
  };
  const double own_right = board ? own.along + own.rate * sim_s : v.at("disk_right_mm");
  const cv::Vec3d at = turn.t() * (seen_at(matrix_of(real.turn), real.right_mm, real.up_mm, real.distance_mm) -
                                   seen_at(matrix_of(sim.turn), sim.right_mm, sim.up_mm, sim.distance_mm) +
                                   seen_at(own_turn, own_right, v.at(board ? "board_up_mm" : "disk_up_mm"),
                                           v.at(board ? "board_distance_mm" : "disk_distance_mm")));
  const cv::Vec3d place = cv::Vec3d(at[0], -at[1], at[2]) * (distance / at[2]);

  // The simulation's own error of the angle, at the recording's middle.
  const double error =
      board ? real.along - place[0]
            : std::remainder(sim.along + sim.rate * (t_s - sim_s) - (own.along + own.rate * t_s), period);
  line.along = real.along - error - line.rate * t_s;
  return finished(scene, real, turn_of(turn), place, line, clock,
                  "measured, less what the same search finds wrong in the simulation");
}

cv::Mat overlay_picture(const events::Recording& real, const LabScene& before, const Aligned& after,
                        const Optics& optics, const events::Recording* sim) {
  constexpr int kRows = 3, kWidth = 800;
  const double times = static_cast<double>(kWidth) / real.width;
  const int height = cvRound(real.height * times);
  cv::Mat sheet(kRows * height, 2 * kWidth, CV_8UC3, {255, 255, 255});
  const cv::Scalar blue(178, 114, 0), orange(0, 94, 213), ink(31, 31, 27);
  const auto window =
      std::max<std::int64_t>(1, std::min<std::int64_t>(view::readable_window_us(real, 5000), real.span_us / 4));
  for (int row = 0; row < kRows; ++row)
    for (int column = 0; column < 2; ++column) {
      cv::Mat panel = sheet(cv::Rect(column * kWidth, row * height, kWidth, height));
      const std::int64_t from = (real.span_us - window) * (row + 1) / (kRows + 1);
      const double file_us = static_cast<double>(real.first_us + from) + 0.5 * static_cast<double>(window);
      const double scene_us = column == 0 ? file_us : after.clock_rate * (file_us - after.clock_offset_us);
      const auto dots = [&](const events::Recording& recording, double middle_us, const cv::Scalar& colour) {
        for (const auto& e : recording.events)
          if (std::abs(static_cast<double>(e.t_us + recording.first_us) - middle_us) * 2 <=
              static_cast<double>(window)) {
            auto& dot = panel.at<cv::Vec3b>(std::min(height - 1, static_cast<int>((e.y + 0.5) * times)),
                                            std::min(kWidth - 1, static_cast<int>((e.x + 0.5) * times)));
            for (int k = 0; k < 3; ++k) dot[k] = static_cast<std::uint8_t>(dot[k] * (0.3 + 0.7 * colour[k] / 255));
          }
      };
      dots(real, file_us, blue);
      if (sim && column == 1) dots(*sim, scene_us, orange);

      const LabScene& s = column == 0 ? before : after.scene;
      const cv::Matx33d turn = matrix_of(turn_from_blender(s.rotation_deg));
      const Line line = line_of(s);
      const double along = line.along + line.rate * scene_us * 1e-6;
      const auto path = [&](const std::vector<cv::Point3d>& points) {
        std::vector<cv::Point> p;
        for (const auto& q : points) {
          const cv::Point2d at = seen(optics, turn, q.x, q.y, q.z) * times;
          p.emplace_back(cvRound(at.x * 16), cvRound(at.y * 16));
        }
        cv::polylines(panel, p, false, orange, 1, cv::LINE_AA, 4);
      };
      if (sim && column == 1) {
      } else if (s.is_board()) {
        const double n = s.values.at("squares"), side = s.values.at("square_mm"), up = s.values.at("board_up_mm"),
                     z = s.values.at("board_distance_mm");
        for (int i = 0; i <= static_cast<int>(n); ++i) {
          const double o = (i - n / 2) * side, half = n / 2 * side;
          std::vector<cv::Point3d> across, down;
          for (int k = -8; k <= 8; ++k) {
            across.emplace_back(along + half * k / 8, -up + o, z);
            down.emplace_back(along + o, -up + half * k / 8, z);
          }
          path(across), path(down);
        }
      } else {
        const double r = s.values.at("disk_radius_mm"), x = s.values.at("disk_right_mm"),
                     y = -s.values.at("disk_up_mm"), z = s.values.at("disk_distance_mm");
        std::vector<cv::Point3d> rim;
        for (int k = 0; k <= 72; ++k)
          rim.emplace_back(x + r * std::cos(k * 5 * kDegree), y + r * std::sin(k * 5 * kDegree), z);
        path(rim);
        const int sectors = static_cast<int>(s.values.at("sectors"));
        for (int k = 0; k < sectors; ++k) {
          const double a = (along + 360.0 * k / sectors) * kDegree;
          path({{x, y, z}, {x + r * std::cos(a), y - r * std::sin(a), z}});
        }
      }
      cv::putText(panel, fmt::format("{}  t = {:.0f} us", column == 0 ? "before" : "aligned", file_us), {8, 18},
                  cv::FONT_HERSHEY_SIMPLEX, 0.5, ink, 1, cv::LINE_AA);
    }
  return sheet;
}

}  // namespace pecs::calibration
