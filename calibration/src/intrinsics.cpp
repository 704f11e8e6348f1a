#include "pecs/calibration/intrinsics.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "pecs/error.h"

namespace pecs::calibration {
namespace {

using Views = std::vector<std::vector<cv::Point2d>>;

constexpr std::size_t kLeastViews = 4, kMostFolds = 12;

std::vector<cv::Point2d> projected(const CameraModel& c, const std::vector<cv::Point3d>& board, const cv::Vec3d& r,
                                   const cv::Vec3d& t) {
  const cv::Matx33d k(c.focal_px, 0, c.principal_px.x, 0, c.focal_px, c.principal_px.y, 0, 0, 1);
  std::vector<cv::Point2d> out;
  if (c.fisheye) {
    cv::fisheye::projectPoints(board, out, r, t, k, c.radial);
  } else {
    const std::array<double, 5> d = {c.radial[0], c.radial[1], c.tangential.x, c.tangential.y, c.radial[2]};
    cv::projectPoints(board, r, t, k, d, out);
  }
  return out;
}

struct Fit {
  CameraModel camera;
  std::vector<cv::Vec3d> r, t;
  std::vector<double> rms;  // per view
};

Fit fit(const Views& views, const std::vector<std::size_t>& use, const std::vector<cv::Point3d>& board, cv::Size size,
        const IntrinsicsOptions& o) {
  Fit f;
  f.camera.fisheye = o.fisheye;
  f.camera.size = size;
  std::vector<cv::Mat> rotations, places;
  const cv::TermCriteria enough(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 200, 1e-10);
  if (o.fisheye) {
    std::vector<std::vector<cv::Point3d>> objects(use.size(), board);
    Views images;
    for (const auto i : use) images.push_back(views[i]);
    cv::Matx33d k;
    cv::Vec4d d;
    cv::fisheye::calibrate(objects, images, size, k, d, rotations, places,
                           cv::fisheye::CALIB_RECOMPUTE_EXTRINSIC | cv::fisheye::CALIB_FIX_SKEW, enough);
    f.camera.focal_px = std::sqrt(k(0, 0) * k(1, 1));
    f.camera.principal_px = {k(0, 2), k(1, 2)};
    f.camera.radial = {d[0], d[1], d[2], d[3]};
  } else {
    std::vector<std::vector<cv::Point3f>> objects(use.size(), {board.begin(), board.end()});
    std::vector<std::vector<cv::Point2f>> images;
    for (const auto i : use) images.emplace_back(views[i].begin(), views[i].end());
    cv::Mat k = cv::Mat::eye(3, 3, CV_64F), d = cv::Mat::zeros(5, 1, CV_64F);
    int flags = cv::CALIB_FIX_ASPECT_RATIO;
    if (!o.tangential) flags |= cv::CALIB_ZERO_TANGENT_DIST;
    if (o.radial < 1) flags |= cv::CALIB_FIX_K1;
    if (o.radial < 2) flags |= cv::CALIB_FIX_K2;
    if (o.radial < 3) flags |= cv::CALIB_FIX_K3;
    cv::calibrateCamera(objects, images, size, k, d, rotations, places, flags, enough);
    f.camera.focal_px = k.at<double>(0, 0);
    f.camera.principal_px = {k.at<double>(0, 2), k.at<double>(1, 2)};
    f.camera.radial = {d.at<double>(0), d.at<double>(1), d.at<double>(4)};
    f.camera.tangential = {d.at<double>(2), d.at<double>(3)};
  }
  for (std::size_t i = 0; i < use.size(); ++i) {
    f.r.emplace_back(rotations[i]), f.t.emplace_back(places[i]);
    const auto p = projected(f.camera, board, f.r[i], f.t[i]);
    double squares = 0;
    for (std::size_t j = 0; j < p.size(); ++j) squares += (p[j] - views[use[i]][j]).dot(p[j] - views[use[i]][j]);
    f.rms.push_back(std::sqrt(squares / static_cast<double>(p.size())));
  }
  return f;
}

std::vector<double*> parameters(CameraModel& c) {
  std::vector<double*> p = {&c.focal_px, &c.principal_px.x, &c.principal_px.y, &c.tangential.x, &c.tangential.y};
  for (double& k : c.radial) p.push_back(&k);
  return p;
}

}  // namespace

Intrinsics intrinsics_of(const Views& views, const BoardShape& shape, cv::Size size, const IntrinsicsOptions& options,
                         const std::string& file) {
  if (views.size() < kLeastViews)
    throw bad_input(file, "views", fmt::format("the board in {} views", views.size()),
                    fmt::format("{} or more, tilted and all over the picture", kLeastViews));
  const auto board = shape.points_mm();
  std::vector<std::size_t> use(views.size());
  std::iota(use.begin(), use.end(), std::size_t{0});
  Intrinsics out;
  out.view_rms_px.assign(views.size(), std::numeric_limits<double>::quiet_NaN());
  Fit best;
  try {
    best = fit(views, use, board, size, options);
    // Discards views that do not fit the others, once.
    std::vector<double> sorted = best.rms;
    std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2), sorted.end());
    const double limit = std::max(0.5, 3 * sorted[sorted.size() / 2]);
    std::vector<std::size_t> kept;
    for (std::size_t i = 0; i < use.size(); ++i)
      if (best.rms[i] <= limit)
        kept.push_back(i);
      else
        out.warnings.push_back(fmt::format("view {} left out: {:.2f} px rms, the others {:.2f}", i, best.rms[i],
                                           sorted[sorted.size() / 2]));
    if (kept.size() < kLeastViews)
      throw bad_input(file, "views", fmt::format("{} views that fit one camera", kept.size()),
                      fmt::format("{} or more", kLeastViews));
    if (kept.size() < use.size()) use = kept, best = fit(views, use, board, size, options);

    // Deviations by the jackknife over groups of views.
    const std::size_t folds = std::min(kMostFolds, use.size());
    std::vector<CameraModel> without;
    for (std::size_t fold = 0; fold < folds; ++fold) {
      std::vector<std::size_t> rest;
      for (std::size_t i = 0; i < use.size(); ++i)
        if (i % folds != fold) rest.push_back(use[i]);
      without.push_back(fit(views, rest, board, size, options).camera);
    }
    out.deviation = best.camera;
    const auto deviations = parameters(out.deviation);
    for (std::size_t k = 0; k < deviations.size(); ++k) {
      double sum = 0, squares = 0;
      for (auto& c : without) {
        const double v = *parameters(c)[k];
        sum += v, squares += v * v;
      }
      const double n = static_cast<double>(folds), mean = sum / n;
      *deviations[k] = std::sqrt(std::max(0.0, (n - 1) / n * (squares - n * mean * mean)));
    }
  } catch (const cv::Exception& e) {
    throw bad_input(file, "views", "views that determine no camera (" + e.err + ")", "a board tilted in several ways");
  }
  out.camera = best.camera;
  out.rotation = best.r, out.at_mm = best.t;
  double squares = 0;
  std::array<bool, 48> cell{};
  for (std::size_t i = 0; i < use.size(); ++i) {
    out.view_rms_px[use[i]] = best.rms[i];
    squares += best.rms[i] * best.rms[i];
    for (const auto& p : views[use[i]]) {
      const int x = std::clamp(static_cast<int>(p.x * 8 / size.width), 0, 7);
      const int y = std::clamp(static_cast<int>(p.y * 6 / size.height), 0, 5);
      cell[static_cast<std::size_t>(y) * 8 + x] = true;
    }
  }
  out.rms_px = std::sqrt(squares / static_cast<double>(use.size()));
  out.coverage = static_cast<double>(std::count(cell.begin(), cell.end(), true)) / static_cast<double>(cell.size());
  if (out.deviation.focal_px > 0.01 * out.camera.focal_px)
    out.warnings.push_back(fmt::format("the views determine the focal length to {:.1f} % only: tilt the board more",
                                       100 * out.deviation.focal_px / out.camera.focal_px));
  if (out.coverage < 0.5)
    out.warnings.push_back(
        fmt::format("points cover {:.0f} % of the picture: distortion beyond them is a guess", 100 * out.coverage));
  return out;
}

std::vector<CurveRow> compare_curves(const Optics& predicted, const Optics& measured, cv::Size size) {
  const double corner = std::hypot(size.width, size.height) / 2;
  const double last = std::min({predicted.angle_at(corner), measured.angle_at(corner)});
  constexpr int kRows = 21;
  std::vector<CurveRow> rows;
  double pm = 0, mm = 0;
  for (int i = 1; i < kRows; ++i) {
    const double a = last * i / (kRows - 1), p = predicted.radius_at(a), m = measured.radius_at(a);
    rows.push_back({a * 180 / CV_PI, p, m, 0});
    pm += p * m, mm += m * m;
  }
  for (auto& row : rows) row.shape_difference_px = row.measured_px * pm / mm - row.predicted_px;
  return rows;
}

Json to_json(const Intrinsics& in) {
  Json rms = Json::array();
  for (const double v : in.view_rms_px) rms.push_back(std::isnan(v) ? Json(nullptr) : Json(v));
  Json deviation = to_json(in.deviation);
  for (const char* key : {"model", "width", "height"}) deviation.erase(key);
  return {{"camera", to_json(in.camera)}, {"deviation", deviation},  {"rms_px", in.rms_px},
          {"view_rms_px", rms},           {"coverage", in.coverage}, {"warnings", in.warnings}};
}

cv::Mat coverage_picture(const Views& views, const Intrinsics& in, const BoardShape& shape,
                         const std::vector<CurveRow>& curve) {
  const cv::Size size = in.camera.size;
  const double times = 1280.0 / size.width;
  const int height = cvRound(size.height * times), below = curve.empty() ? 0 : 360;
  cv::Mat picture(height + below, 1280, CV_8UC3, {255, 255, 255});
  const cv::Scalar ink(31, 31, 27), grey(190, 190, 190), blue(178, 114, 0), orange(0, 94, 213);
  const auto at = [&](const cv::Point2d& p) { return cv::Point(cvRound(p.x * times), cvRound(p.y * times)); };
  for (int i = 1; i < 8; ++i) cv::line(picture, {160 * i, 0}, {160 * i, height}, grey);
  for (int i = 1; i < 6; ++i) cv::line(picture, {0, height * i / 6}, {1280, height * i / 6}, grey);
  const auto board = shape.points_mm();
  std::size_t used = 0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const bool in_use = !std::isnan(in.view_rms_px[i]);
    std::vector<cv::Point2d> model = views[i];
    if (in_use) model = projected(in.camera, board, in.rotation[used], in.at_mm[used]), ++used;
    for (std::size_t k = 0; k < model.size(); ++k) {
      cv::circle(picture, at(views[i][k]), 3, in_use ? blue : grey, cv::FILLED, cv::LINE_AA);
      cv::line(picture, at(views[i][k]), at(views[i][k] + 50 * (views[i][k] - model[k])), orange, 1, cv::LINE_AA);
    }
  }
  cv::drawMarker(picture, at(in.camera.principal_px), ink, cv::MARKER_CROSS, 18, 1, cv::LINE_AA);
  const auto put = [&](const std::string& text, int x, int y, const cv::Scalar& colour) {
    cv::putText(picture, text, {x, y}, cv::FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv::LINE_AA);
  };
  put(fmt::format("{} views, {:.3f} px rms, {:.0f} % of the cells; residuals x50", used, in.rms_px, 100 * in.coverage),
      10, 20, ink);
  if (curve.empty()) return picture;

  // Both distortions relative to r = k tan(angle), in per cent.
  const auto percent = [&](double angle_deg, double r, double first) {
    return 100 * (r / std::tan(angle_deg * CV_PI / 180) / first - 1);
  };
  std::array<std::vector<double>, 2> d;
  double top = 0.1;
  for (const auto& row : curve) {
    d[0].push_back(
        percent(row.angle_deg, row.predicted_px, curve[0].predicted_px / std::tan(curve[0].angle_deg * CV_PI / 180)));
    d[1].push_back(
        percent(row.angle_deg, row.measured_px, curve[0].measured_px / std::tan(curve[0].angle_deg * CV_PI / 180)));
    top = std::max({top, std::abs(d[0].back()), std::abs(d[1].back())});
  }
  const int middle = height + below / 2;
  cv::line(picture, {60, middle}, {1240, middle}, grey);
  for (int k = 0; k < 2; ++k)
    for (std::size_t i = 1; i < curve.size(); ++i) {
      const auto point = [&](std::size_t j) {
        return cv::Point(cvRound(60 + 1180 * curve[j].angle_deg / curve.back().angle_deg),
                         cvRound(middle - 140 * d[static_cast<std::size_t>(k)][j] / top));
      };
      cv::line(picture, point(i - 1), point(i), k ? orange : blue, 2, cv::LINE_AA);
    }
  put(fmt::format("distortion, +-{:.2f} %, to {:.1f} deg", top, curve.back().angle_deg), 10, height + 24, ink);
  put("lens prescription", 400, height + 24, blue);
  put("measured", 620, height + 24, orange);
  return picture;
}

}  // namespace pecs::calibration
