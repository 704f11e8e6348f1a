#include "pecs/calibration/board.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "pecs/error.h"

namespace pecs::calibration {
namespace {

// 8-bit grey levels; the 2 % and 98 % quantiles of the values become black and white.
cv::Mat grey(const cv::Mat& picture, double part = 0.02) {
  std::vector<float> sorted(picture.begin<float>(), picture.end<float>());
  const auto at = [&](double p) {
    const auto i = static_cast<std::ptrdiff_t>(p * static_cast<double>(sorted.size() - 1));
    std::nth_element(sorted.begin(), sorted.begin() + i, sorted.end());
    return static_cast<double>(sorted[static_cast<std::size_t>(i)]);
  };
  const double low = at(part), high = std::max(at(1 - part), low + 1e-9);
  cv::Mat out;
  picture.convertTo(out, CV_8U, 255 / (high - low), -low * 255 / (high - low));
  return out;
}

// Mean distance of neighbours along rows or along columns, the smaller one: a tilted board is narrower in one
// direction.
double spacing_px(const std::vector<cv::Point2d>& points, int columns) {
  const auto width = static_cast<std::size_t>(columns);
  double along = 0, across = 0;
  for (std::size_t i = 1; i < points.size(); ++i) {
    if (i % width != 0) along += cv::norm(points[i] - points[i - 1]);
    if (i >= width) across += cv::norm(points[i] - points[i - width]);
  }
  const std::size_t rows = points.size() / width;
  return std::min(along / static_cast<double>(rows * (width - 1)), across / static_cast<double>((rows - 1) * width));
}

// Reorders a grid of points, which starts at any corner and has either handedness, to the reading nearest to upright:
// columns to the right, rows down. Empty when the counts do not match the shape.
std::vector<cv::Point2d> upright(const std::vector<cv::Point2d>& found, int columns, int rows,
                                 const BoardShape& shape) {
  std::vector<cv::Point2d> best;
  double best_score = -1e30;
  for (int turn = 0; turn < 8; ++turn) {
    const bool swap = turn & 4;
    const int c = swap ? rows : columns, r = swap ? columns : rows;
    if (c != shape.columns || r != shape.rows) continue;
    std::vector<cv::Point2d> p;
    for (int y = 0; y < r; ++y)
      for (int x = 0; x < c; ++x) {
        const int u = turn & 1 ? c - 1 - x : x, v = turn & 2 ? r - 1 - y : y;
        p.push_back(found[static_cast<std::size_t>(swap ? u * columns + v : v * columns + u)]);
      }
    const cv::Point2d right = p[static_cast<std::size_t>(c - 1)] - p[0],
                      down = p[p.size() - static_cast<std::size_t>(c)] - p[0];
    if (right.cross(down) <= 0) continue;
    const double score = right.x / cv::norm(right) + down.y / cv::norm(down);
    if (score > best_score) best_score = score, best = std::move(p);
  }
  return best;
}

// Residual of a homography of the flat board, in spacings: small for lens distortion, large for wrong points.
double grid_error(const std::vector<cv::Point2d>& points, const BoardShape& shape) {
  std::vector<cv::Point2d> flat, mapped;
  for (const auto& p : shape.points_mm()) flat.emplace_back(p.x, p.y);
  const cv::Mat h = cv::findHomography(flat, points);
  if (h.empty()) return 1e9;
  cv::perspectiveTransform(flat, mapped, h);
  double worst = 0;
  for (std::size_t i = 0; i < points.size(); ++i) worst = std::max(worst, cv::norm(points[i] - mapped[i]));
  return worst / std::max(1e-9, spacing_px(points, shape.columns));
}

void refine_corners(const cv::Mat& picture, std::vector<cv::Point2d>& points, int columns) {
  std::vector<cv::Point2f> p(points.begin(), points.end());
  for (auto& q : p) q -= cv::Point2f(0.5F, 0.5F);  // OpenCV's pixel centres are integers
  const int half = std::clamp(static_cast<int>(0.4 * spacing_px(points, columns)), 2, 12);
  cv::cornerSubPix(picture, p, {half, half}, {-1, -1}, {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 50, 1e-3});
  for (std::size_t i = 0; i < p.size(); ++i) points[i] = cv::Point2d(p[i].x + 0.5, p[i].y + 0.5);
}

std::vector<cv::Point2d> checkerboard(const cv::Mat& picture, const BoardShape& shape, std::string& why) {
  // Detects the largest board: with a given size, OpenCV may return a part of a larger board.
  constexpr int kFlags = cv::CALIB_CB_LARGER | cv::CALIB_CB_NORMALIZE_IMAGE;
  why = "no checkerboard of 3 x 3 inner corners or more";
  for (const int more : {0, cv::CALIB_CB_EXHAUSTIVE | cv::CALIB_CB_ACCURACY}) {  // the first may find a part alone
    std::vector<cv::Point2f> p;
    cv::Mat meta;
    if (!cv::findChessboardCornersSB(picture, {3, 3}, p, kFlags | more, meta) || p.empty() || meta.empty()) continue;
    std::vector<cv::Point2d> points;
    for (const auto& q : p) points.emplace_back(q.x + 0.5, q.y + 0.5);
    if (auto found = upright(points, meta.cols, meta.rows, shape); !found.empty()) return found;
    why = fmt::format("a checkerboard of {} x {} inner corners about ({:.0f}, {:.0f})", std::max(meta.cols, meta.rows),
                      std::min(meta.cols, meta.rows), points[points.size() / 2].x, points[points.size() / 2].y);
  }
  return {};
}

std::vector<cv::Point2d> circles(const cv::Mat& picture, const BoardShape& shape, std::string& why) {
  const int kind = shape.pattern == Pattern::circles ? cv::CALIB_CB_SYMMETRIC_GRID : cv::CALIB_CB_ASYMMETRIC_GRID;
  cv::SimpleBlobDetector::Params params;
  params.minArea = 20;
  params.maxArea = static_cast<float>(picture.total()) / 16;
  params.minDistBetweenBlobs = 4;
  params.thresholdStep = 5;
  params.filterByConvexity = false;
  std::vector<cv::Point2f> p;
  std::size_t most = 0;
  for (const uchar colour : {uchar{0}, uchar{255}}) {
    params.blobColor = colour;
    const auto detector = cv::SimpleBlobDetector::create(params);
    if (cv::findCirclesGrid(picture, {shape.columns, shape.rows}, p, kind, detector)) {
      std::vector<cv::Point2d> points;
      for (const auto& q : p) points.emplace_back(q.x + 0.5, q.y + 0.5);
      // An asymmetric grid has one reading, or two if its rows are even in number; OpenCV's is kept.
      return kind == cv::CALIB_CB_SYMMETRIC_GRID ? upright(points, shape.columns, shape.rows, shape) : points;
    }
    std::vector<cv::KeyPoint> blobs;
    detector->detect(picture, blobs);
    most = std::max(most, blobs.size());
  }
  why = fmt::format("{} blobs of one colour, no grid", most);
  return {};
}

// Deviation of points that were found on the picture of all events: by their difference on the pictures of either half
// of the events, picture_of(0) and picture_of(1). None if a half shows no board.
std::optional<double> deviation_px(const std::vector<cv::Point2d>& points, const BoardShape& shape,
                                   const auto& picture_of, std::string& why) {
  std::array<std::vector<cv::Point2d>, 2> half = {points, points};
  for (int i = 0; i < 2; ++i)
    if (shape.pattern == Pattern::checkerboard) {
      refine_corners(picture_of(i), half[i], shape.columns);
    } else if (std::string unused; (half[i] = board_points(picture_of(i), shape, unused)).empty()) {
      why = "found on all events, but not on either half of them";
      return {};
    }
  double squares = 0;
  for (std::size_t k = 0; k < points.size(); ++k) {
    const cv::Point2d d = half[0][k] - half[1][k];
    squares += d.dot(d);
  }
  return 0.5 * std::sqrt(squares / (2.0 * static_cast<double>(points.size())));
}

// ---- moving boards --------------------------------------------------------------------------------------------------

std::optional<BoardView> moving_board(const events::Recording& recording, const BoardShape& shape, double t_us,
                                      std::string& why) {
  const cv::Size size(recording.width, recording.height);
  const auto view = estimate_flow(recording.events, size, t_us, why);
  if (!view) return {};
  const auto picture_of = [&](int part) {
    cv::Mat sharp = log_intensity(*view, image_of_warped_events(*view, size, part));
    cv::GaussianBlur(sharp, sharp, {}, 0.8);
    return grey(sharp);
  };
  BoardView board;
  board.picture = picture_of(-1);
  board.points = board_points(board.picture, shape, why);
  if (board.points.empty()) return {};

  const auto deviation = deviation_px(board.points, shape, picture_of, why);
  if (!deviation) return {};
  board.deviation_px = *deviation;
  board.t_us = t_us + static_cast<double>(recording.first_us);
  board.motion = view->flow.kind;
  const cv::Point2d middle = board.points[board.points.size() / 2];
  board.speed_px_s = cv::norm(view->flow.at(middle.x, middle.y));
  return board;
}

[[noreturn]] void nothing(const BoardSearch& search, const BoardShape& shape, const std::string& file) {
  std::map<std::string, int> reasons;
  for (const auto& line : search.missed) ++reasons[line.substr(line.find(": ") + 2)];
  const auto most = std::max_element(reasons.begin(), reasons.end(),
                                     [](const auto& a, const auto& b) { return a.second < b.second; });
  throw bad_input(file, "board",
                  fmt::format("nothing found in {} windows (best candidate: {})", search.missed.size(),
                              reasons.empty() ? "none" : most->first),
                  "a " + shape.text() + " in view");
}

// ---- blinking -------------------------------------------------------------------------------------------------------

// The frequency at which ON and OFF alternate: the peak of the power spectrum of the signed event rate. Powers are
// summed over blocks of the picture, so that squares of opposite phase add up.
double blink_frequency_hz(std::span<const events::Event> events, cv::Size size, double span_s, double& contrast) {
  constexpr std::size_t kBlocks = 12;
  const int bins = static_cast<int>(std::clamp(span_s / 50e-6, 256.0, 65536.0));
  const int padded = cv::getOptimalDFTSize(4 * bins);
  std::vector<cv::Mat_<float>> rate(kBlocks * kBlocks);
  for (auto& r : rate) r = cv::Mat_<float>(1, padded, 0.0F);
  for (const auto& e : events) {
    const auto bin = static_cast<int>(static_cast<double>(e.t_us - events.front().t_us) * 1e-6 / span_s * bins);
    rate[e.y * kBlocks / size.height * kBlocks + e.x * kBlocks / size.width](0, std::clamp(bin, 0, bins - 1)) +=
        e.p ? 1.0F : -1.0F;
  }
  std::vector<double> power(static_cast<std::size_t>(padded / 2), 0.0);
  for (auto& r : rate) {
    cv::Mat_<cv::Vec2f> spectrum;
    cv::dft(r, spectrum, cv::DFT_COMPLEX_OUTPUT);
    for (int i = 1; i < padded / 2; ++i) power[static_cast<std::size_t>(i)] += spectrum(0, i).dot(spectrum(0, i));
  }
  const auto peak = std::max_element(power.begin() + 8, power.end());
  double mean = 0;
  for (const double p : power) mean += p / static_cast<double>(power.size());
  contrast = *peak / std::max(mean, 1e-30);
  const auto i = static_cast<std::size_t>(peak - power.begin());
  double offset = 0;
  if (i + 1 < power.size()) {
    const double a = power[i - 1], b = power[i], c = power[i + 1];
    if (a - 2 * b + c < 0) offset = 0.5 * (a - c) / (a - 2 * b + c);
  }
  return (static_cast<double>(i) + offset) / (padded * span_s / bins);
}

// Per pixel the correlation of its polarities with the blinking, signed by the most common phase.
cv::Mat in_step(std::span<const events::Event> events, cv::Size size, double frequency_hz, int part) {
  cv::Mat_<cv::Vec2d> sums(size, cv::Vec2d(0, 0));
  std::size_t i = 0;
  for (const auto& e : events) {
    if (part >= 0 && static_cast<int>(i++ % 2) != part) continue;
    const double angle = 2 * std::numbers::pi * frequency_hz * 1e-6 * static_cast<double>(e.t_us - events.front().t_us);
    sums(e.y, e.x) += (e.p ? 1.0 : -1.0) * cv::Vec2d(std::cos(angle), std::sin(angle));
  }
  cv::Vec2d doubled(0, 0);  // of the doubled phase, which opposite squares share
  for (const auto& s : sums) doubled += cv::Vec2d(s[0] * s[0] - s[1] * s[1], 2 * s[0] * s[1]);
  const double phase = 0.5 * std::atan2(doubled[1], doubled[0]);
  cv::Mat_<float> picture(size, 0.0F);
  for (int y = 0; y < size.height; ++y)
    for (int x = 0; x < size.width; ++x)
      picture(y, x) = static_cast<float>(sums(y, x)[0] * std::cos(phase) + sums(y, x)[1] * std::sin(phase));
  return picture;
}

}  // namespace

Pattern pattern_from(const std::string& name) {
  if (name == "checkerboard") return Pattern::checkerboard;
  if (name == "circles") return Pattern::circles;
  if (name == "asymmetric-circles") return Pattern::asymmetric_circles;
  throw Error(ExitCode::usage,
              fmt::format("--target: got '{}', wanted disk, checkerboard, circles or asymmetric-circles", name));
}

std::string BoardShape::text() const {
  if (pattern == Pattern::checkerboard) return fmt::format("checkerboard of {} x {} inner corners", columns, rows);
  return fmt::format("{} grid of {} x {} circles", pattern == Pattern::circles ? "symmetric" : "asymmetric", columns,
                     rows);
}

std::vector<cv::Point3d> BoardShape::points_mm() const {
  std::vector<cv::Point3d> points;
  for (int y = 0; y < rows; ++y)
    for (int x = 0; x < columns; ++x)
      points.emplace_back(pattern == Pattern::asymmetric_circles ? (2 * x + y % 2) * spacing_mm : x * spacing_mm,
                          y * spacing_mm, 0);
  const double right = pattern == Pattern::asymmetric_circles ? 2 * columns - 1 : columns - 1;
  for (auto& p : points) p -= cv::Point3d(right * spacing_mm / 2, (rows - 1) * spacing_mm / 2, 0);
  return points;
}

std::vector<cv::Point2d> board_points(const cv::Mat& picture, const BoardShape& shape, std::string& why) {
  auto points =
      shape.pattern == Pattern::checkerboard ? checkerboard(picture, shape, why) : circles(picture, shape, why);
  if (points.empty()) return points;
  if (shape.pattern == Pattern::checkerboard) refine_corners(picture, points, shape.columns);
  const double error = grid_error(points, shape);
  if (error > 0.15) {
    why = fmt::format("a grid of the right size that is not flat (points off by {:.2f} of their spacing)", error);
    return {};
  }
  return points;
}

BoardSearch find_boards(const events::Recording& recording, const BoardShape& shape, int count,
                        const std::string& file) {
  std::vector<std::optional<BoardView>> found(static_cast<std::size_t>(count));
  std::vector<std::string> why(found.size());
  std::vector<double> t_us(found.size());
  tbb::parallel_for(std::size_t{0}, found.size(), [&](std::size_t i) {
    t_us[i] = static_cast<double>(recording.span_us) * (static_cast<double>(i) + 0.5) / count;
    found[i] = moving_board(recording, shape, t_us[i], why[i]);
  });
  BoardSearch search;
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (found[i])
      search.views.push_back(std::move(*found[i]));
    else
      search.missed.push_back(
          fmt::format("t = {:.0f} us: {}", t_us[i] + static_cast<double>(recording.first_us), why[i]));
  }
  if (search.views.empty()) nothing(search, shape, file);
  return search;
}

BoardSearch find_blinking_boards(const events::Recording& recording, const BoardShape& shape, int count,
                                 const std::string& file, Blinking& blinking) {
  const cv::Size size(recording.width, recording.height);
  double contrast = 0;
  blinking.frequency_hz =
      blink_frequency_hz(recording.events, size, static_cast<double>(recording.span_us) * 1e-6, contrast);
  if (contrast < 20)
    throw bad_input(file, "board",
                    fmt::format("nothing blinks (best candidate: {:.1f} Hz, {:.1f} times the mean power)",
                                blinking.frequency_hz, contrast),
                    "a blinking " + shape.text());
  BoardSearch search;
  for (int i = 0; i < count; ++i) {
    const std::int64_t begin = recording.span_us * i / count, end = recording.span_us * (i + 1) / count;
    const auto events = events::between(recording.events, static_cast<double>(begin), static_cast<double>(end));
    std::string why = "no events";
    BoardView view;
    const auto picture_of = [&](int part) { return grey(in_step(events, size, blinking.frequency_hz, part)); };
    std::optional<double> deviation;
    if (!events.empty()) {
      view.picture = picture_of(-1);
      view.points = board_points(view.picture, shape, why);
      if (!view.points.empty()) deviation = deviation_px(view.points, shape, picture_of, why);
    }
    view.t_us = static_cast<double>(recording.first_us) + 0.5 * static_cast<double>(begin + end);
    view.motion = "blinking";
    if (!deviation) {
      search.missed.push_back(fmt::format("t = {:.0f} us: {}", view.t_us, why));
      continue;
    }
    view.deviation_px = *deviation;
    search.views.push_back(std::move(view));
  }
  if (search.views.empty()) nothing(search, shape, file);
  return search;
}

Json to_json(const BoardSearch& search, const BoardShape& shape) {
  Json views = Json::array();
  for (const auto& v : search.views) {
    Json points = Json::array();
    for (const auto& p : v.points) points.push_back({p.x, p.y});
    views.push_back({{"time_us", v.t_us},
                     {"points", points},
                     {"deviation_px", v.deviation_px},
                     {"motion", v.motion},
                     {"speed_px_s", v.speed_px_s}});
  }
  return {{"target", shape.text()}, {"views", views}, {"missed", search.missed}};
}

cv::Mat board_picture(const BoardSearch& search, const BoardShape& shape) {
  constexpr int kWidth = 640, kMost = 12;
  const int count = std::min(kMost, static_cast<int>(search.views.size())), columns = count > 1 ? 2 : 1;
  cv::Mat sheet;
  for (int i = 0; i < count; ++i) {
    const auto& view =
        search.views[search.views.size() * static_cast<std::size_t>(i) / static_cast<std::size_t>(count)];
    const double times = static_cast<double>(kWidth) / view.picture.cols;
    cv::Mat panel;
    cv::resize(view.picture, panel, {kWidth, cvRound(view.picture.rows * times)}, 0, 0, cv::INTER_AREA);
    cv::cvtColor(panel, panel, cv::COLOR_GRAY2BGR);
    std::vector<cv::Point2f> points;
    for (const auto& p : view.points) points.emplace_back(p * times - cv::Point2d(0.5, 0.5));
    cv::drawChessboardCorners(panel, {shape.columns, shape.rows}, points, true);
    cv::putText(panel, fmt::format("t = {:.0f} us, {}, +-{:.3f} px", view.t_us, view.motion, view.deviation_px),
                {8, 18}, cv::FONT_HERSHEY_SIMPLEX, 0.45, {0, 90, 220}, 1, cv::LINE_AA);
    if (sheet.empty())
      sheet = cv::Mat((count + columns - 1) / columns * panel.rows, columns * kWidth, CV_8UC3, {255, 255, 255});
    panel.copyTo(sheet(cv::Rect(i % columns * kWidth, i / columns * panel.rows, panel.cols, panel.rows)));
  }
  return sheet;
}

}  // namespace pecs::calibration
