#include <ceres/ceres.h>
#include <ceres/cubic_interpolation.h>
#include <ceres/rotation.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "camera_axes.h"
#include "find_target.h"
#include "pecs/error.h"

namespace pecs::calibration {
namespace {

// Residual of a corner: measured position minus the projection of the board at (right + speed t, up, distance), rotated
// with the camera. Drift: speed across the board's rows, up and forward.
struct CornerError {
  const ceres::CubicInterpolator<ceres::Grid1D<double>>& radius;
  const Optics& optics;
  cv::Point3d on_board;
  cv::Point2d pixel;
  double t_s, deviation_px;

  template <class T>
  bool operator()(const T* rotation, const T* position, const T* speed, const T* drift, T* error) const {
    const T world[3] = {position[0] + speed[0] * t_s + on_board.x, -(position[1] + drift[0] * t_s) + on_board.y,
                        position[2] + drift[1] * t_s};
    T p[3];
    ceres::AngleAxisRotatePoint(rotation, world, p);
    const T across = sqrt(p[0] * p[0] + p[1] * p[1] + 1e-12);
    T r;
    radius.Evaluate(atan2(across, p[2]) / optics.step_rad, &r);
    error[0] = (optics.axis_px.x + p[0] * r / across - pixel.x) / deviation_px;
    error[1] = (optics.axis_px.y + p[1] * r / across - pixel.y) / deviation_px;
    return true;
  }
};

struct BoardPose {
  std::array<double, 3> rotation{}, position{};  // position: right, up, distance at time_us [mm]
  double speed = 0;                              // to the right, mm/s
  std::array<double, 2> drift{};
};

double rms(const std::vector<double>& v) {
  double squares = 0;
  for (const double x : v) squares += x * x;
  return v.empty() ? 0 : std::sqrt(squares / static_cast<double>(v.size()));
}

class BoardFit {
 public:
  BoardFit(const LabScene& scene, const Optics& optics, const Search& how, const BoardShape& shape, double middle_us,
           const std::vector<BoardView>& views)
      : optics_(optics), how_(how), board_(shape.points_mm()), middle_us_(middle_us), views_(views) {
    guess(scene);
  }

  void solve();
  void judge(const std::string& file, std::vector<std::string>& warnings);  // rejects motion that is not uniform
  std::map<std::string, double> deviations() const;
  Json residual(std::vector<std::string>& warnings);  // also fits the drift
  const BoardPose& pose() const { return pose_; }

 private:
  double seconds(const BoardView& v) const { return (v.t_us - middle_us_) * 1e-6; }
  void guess(const LabScene& scene);
  void run();

  const Optics& optics_;
  const Search& how_;
  std::vector<cv::Point3d> board_;
  double middle_us_;
  const std::vector<BoardView>& views_;
  BoardPose pose_;
  ceres::Grid1D<double> grid_{optics_.radius_px.data(), 0, static_cast<int>(optics_.radius_px.size())};
  ceres::CubicInterpolator<ceres::Grid1D<double>> radius_{grid_};
  ceres::Problem problem_;
  std::vector<double> all_, scaled_, view_rms_;  // residuals: px; in standard deviations; rms by view
  std::vector<cv::Point2d> predicted_, measured_;
};

// Initial guess: the pose in the middle view, and the speed from the others.
void BoardFit::guess(const LabScene& scene) {
  std::vector<double> t, right;
  cv::Matx33d rotation = matrix_of(rotation_from_blender(scene.rotation_deg));
  for (std::size_t k = 0; k < views_.size(); ++k) {
    const auto& v = views_[(k + views_.size() / 2) % views_.size()];
    std::vector<cv::Point2d> flat;
    for (const auto& p : v.points) flat.push_back(optics_.normalised(p));
    cv::Vec3d r, at;
    cv::solvePnP(board_, flat, cv::Matx33d::eye(), cv::noArray(), r, at, false, cv::SOLVEPNP_IPPE);
    if (k == 0) {
      if (how_.hold_camera) r = rotation_of(rotation);
      rotation = matrix_of(r);
      const cv::Vec3d p = rotation.t() * at;
      pose_.position = {p[0], -p[1], p[2]};
      std::copy_n(r.val, 3, pose_.rotation.begin());
    }
    t.push_back(seconds(v)), right.push_back((rotation.t() * at)[0]);
  }
  double mean_t = 0, mean_r = 0, tt = 0, tr = 0;
  for (std::size_t k = 0; k < t.size(); ++k) mean_t += t[k] / double(t.size()), mean_r += right[k] / double(t.size());
  for (std::size_t k = 0; k < t.size(); ++k) tt += (t[k] - mean_t) * (t[k] - mean_t), tr += (t[k] - mean_t) * right[k];
  pose_.speed = tr / tt;
  pose_.position[0] = mean_r - pose_.speed * mean_t;
}

void BoardFit::run() {
  ceres::Solver::Options options;
  options.logging_type = ceres::SILENT;
  options.max_num_iterations = 100;
  options.function_tolerance = 1e-10;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem_, &summary);
}

// Fits all views together with a robust loss.
void BoardFit::solve() {
  for (const auto& v : views_)
    for (std::size_t i = 0; i < board_.size(); ++i)
      problem_.AddResidualBlock(
          new ceres::AutoDiffCostFunction<CornerError, 2, 3, 3, 1, 2>(
              new CornerError{radius_, optics_, board_[i], v.points[i], seconds(v), std::hypot(v.deviation_px, 0.05)}),
          new ceres::HuberLoss(2), pose_.rotation.data(), pose_.position.data(), &pose_.speed, pose_.drift.data());
  problem_.SetParameterBlockConstant(pose_.drift.data());
  if (how_.hold_camera) problem_.SetParameterBlockConstant(pose_.rotation.data());
  run();

  const cv::Matx33d r = matrix_of(cv::Vec3d(pose_.rotation.data()));
  for (const auto& v : views_) {
    std::vector<double> view;
    for (std::size_t i = 0; i < board_.size(); ++i) {
      const cv::Point2d p = project(optics_, r, pose_.position[0] + pose_.speed * seconds(v) + board_[i].x,
                                    -pose_.position[1] + board_[i].y, pose_.position[2]);
      const cv::Point2d d = v.points[i] - p;
      predicted_.push_back(p), measured_.push_back(v.points[i]);
      for (const double x : {d.x, d.y})
        view.push_back(x), all_.push_back(x), scaled_.push_back(x / std::hypot(v.deviation_px, 0.05));
    }
    view_rms_.push_back(rms(view));
  }
}

void BoardFit::judge(const std::string& file, std::vector<std::string>& warnings) {
  std::vector<std::string> off;
  for (std::size_t k = 0; k < views_.size(); ++k)
    if (view_rms_[k] > 1)
      off.push_back(fmt::format("the board at t = {:.0f} us lies {:.1f} px (rms) off a uniform motion", views_[k].t_us,
                                view_rms_[k]));
  if (3 * off.size() > views_.size())
    throw bad_input(
        file, "motion",
        fmt::format("a board that does not slide uniformly ({} of {} views; {})", off.size(), views_.size(), off[0]),
        "one speed along its rows; cut the recording where it stops or turns back");
  warnings = off;
}

std::map<std::string, double> BoardFit::deviations() const {
  std::map<std::string, double> deviation;
  ceres::Covariance::Options c;
  c.algorithm_type = ceres::DENSE_SVD;
  ceres::Covariance covariance(c);
  const std::vector<std::pair<const double*, const double*>> wanted = {{pose_.rotation.data(), pose_.rotation.data()},
                                                                       {pose_.position.data(), pose_.position.data()},
                                                                       {&pose_.speed, &pose_.speed}};
  if (!covariance.Compute(wanted, const_cast<ceres::Problem*>(&problem_))) return deviation;
  std::array<double, 9> rotation_c, position_c;
  double speed_c = 0;
  covariance.GetCovarianceBlock(pose_.rotation.data(), pose_.rotation.data(), rotation_c.data());
  covariance.GetCovarianceBlock(pose_.position.data(), pose_.position.data(), position_c.data());
  covariance.GetCovarianceBlock(&pose_.speed, &pose_.speed, &speed_c);
  const double scale = std::max(1.0, rms(scaled_));
  const char* turns[] = {"turn_x_deg", "turn_y_deg", "turn_z_deg"};
  const char* places[] = {"start_right_mm", "board_up_mm", "board_distance_mm"};
  for (std::size_t i = 0; i < 3; ++i) {
    deviation[turns[i]] = scale * std::sqrt(rotation_c[4 * i]) / kDegree;
    deviation[places[i]] = scale * std::sqrt(position_c[4 * i]);
  }
  deviation["speed_m_per_s"] = scale * std::sqrt(speed_c) * 1e-3;
  return deviation;
}

// Fits the motion across the board's rows and a homography of the residuals; both are reported, not applied.
Json BoardFit::residual(std::vector<std::string>& warnings) {
  problem_.SetParameterBlockVariable(pose_.drift.data());
  run();
  const double tilt = std::hypot(pose_.drift[0], pose_.drift[1]) / std::max(1e-9, std::abs(pose_.speed)) / kDegree;
  std::vector<double> warped;
  Json warp = nullptr;
  if (const cv::Mat h = cv::findHomography(predicted_, measured_); !h.empty()) {
    std::vector<cv::Point2d> q;
    cv::perspectiveTransform(predicted_, q, h);
    for (std::size_t i = 0; i < q.size(); ++i)
      for (const double x : {measured_[i].x - q[i].x, measured_[i].y - q[i].y}) warped.push_back(x);
    warp = {{"matrix", std::vector<double>(h.begin<double>(), h.end<double>())}, {"rms_px", rms(warped)}};
  }
  if (tilt > 2)
    warnings.push_back(fmt::format("the board moves at {:.1f} deg to its rows; the scene moves it along them", tilt));
  return {{"rms_px", rms(all_)}, {"view_rms_px", view_rms_}, {"motion_off_rows_deg", tilt}, {"homography", warp}};
}

}  // namespace

TargetEstimate find_sliding_board(const events::Recording& recording, const LabScene& scene, const Optics& optics,
                                  const Search& how, const std::string& file) {
  const int inner = static_cast<int>(scene.values.at("squares")) - 1;
  if (inner < 3)
    throw Error(ExitCode::unsupported, fmt::format("{}: squares: got {}, wanted at least 4", scene.file, inner + 1));
  const BoardShape shape{Pattern::checkerboard, inner, inner, scene.values.at("square_mm")};
  BoardSearch search = find_boards(recording, shape, how.views, file);
  if (search.views.size() < 3)
    throw bad_input(file, "board", fmt::format("the board at {} instants", search.views.size()), "at 3 or more");

  TargetEstimate found;
  found.time_us = static_cast<double>(recording.first_us) + 0.5 * static_cast<double>(recording.span_us);
  BoardFit fit(scene, optics, how, shape, found.time_us, search.views);
  fit.solve();
  fit.judge(file, found.warnings);
  for (const auto& line : search.missed) found.warnings.push_back("no board at " + line);
  found.deviation = fit.deviations();
  found.rotation = cv::Vec3d(fit.pose().rotation.data());
  found.position_mm = cv::Vec3d(fit.pose().position.data());
  found.motion = BoardMotion{fit.pose().position[0], fit.pose().speed};
  found.residual = fit.residual(found.warnings);
  found.views = std::move(search.views);
  return found;
}

}  // namespace pecs::calibration
