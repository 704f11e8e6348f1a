#include "pecs/calibration/contrast_maximisation.h"

#include <ceres/gradient_problem.h>
#include <ceres/gradient_problem_solver.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "pecs/events/recording.h"

namespace pecs::calibration {
namespace {

using events::Event;

constexpr int kBinnedWidth = 480;           // of the pictures that flow is estimated on
constexpr std::size_t kFirstEvents = 3000;  // of the shortest window
constexpr double kLeastTravel_px = 4, kTravel_px = 16, kMostTurn_rad = 0.05;
constexpr double kLeastGain = 1.15;         // contrast with flow over that without
constexpr std::size_t kMostVotes = 40'000;  // events that a contrast is computed from

// Parameters of Flow that each kind of motion has: columns of the basis.
using Basis = std::vector<std::array<double, 8>>;
Basis basis_of(const std::string& kind) {
  Basis b = {{1, 0, 0, 0, 0, 0, 0, 0}, {0, 0, 0, 1, 0, 0, 0, 0}};
  if (kind == "similarity") b.insert(b.end(), {{0, 1, 0, 0, 0, 1, 0, 0}, {0, 0, 1, 0, -1, 0, 0, 0}});
  if (kind == "homography")
    for (const int i : {1, 2, 4, 5, 6, 7}) b.emplace_back()[static_cast<std::size_t>(i)] = 1;
  return b;
}

// Bilinear weights of the four pixels about (x, y) and their derivatives by x, for accumulation and interpolation.
struct Corner {
  int x, y;
  float fx, fy;
};
bool corner_at(double x, double y, cv::Size size, Corner& c) {
  const double u = x - 0.5, v = y - 0.5;
  c.x = static_cast<int>(std::floor(u)), c.y = static_cast<int>(std::floor(v));
  c.fx = static_cast<float>(u - c.x), c.fy = static_cast<float>(v - c.y);
  return c.x >= 0 && c.y >= 0 && c.x + 1 < size.width && c.y + 1 < size.height;
}
void vote(cv::Mat_<float>& m, const Corner& c, float value) {
  m(c.y, c.x) += value * (1 - c.fx) * (1 - c.fy);
  m(c.y, c.x + 1) += value * c.fx * (1 - c.fy);
  m(c.y + 1, c.x) += value * (1 - c.fx) * c.fy;
  m(c.y + 1, c.x + 1) += value * c.fx * c.fy;
}

// Minus the sum of squares of the blurred image of warped events. Parameters: displacements at the window's ends [px at
// one scale from the centre], so that all have the same magnitude.
class Contrast : public ceres::FirstOrderFunction {
 public:
  Contrast(std::span<const Event> events, double t_us, double half_s, const Flow& frame, Basis basis, cv::Size size,
           double sigma)
      : frame_(frame), basis_(std::move(basis)), half_s_(half_s), sigma_(sigma) {
    bin_ = std::max(1, size.width / kBinnedWidth);
    binned_ = {size.width / bin_ + 1, size.height / bin_ + 1};
    const std::size_t step = 1 + events.size() / kMostVotes;
    for (std::size_t i = 0; i < events.size(); i += step)
      votes_.push_back({events[i].x + 0.5, events[i].y + 0.5, (static_cast<double>(events[i].t_us) - t_us) * 1e-6,
                        events[i].p ? 1.0F : -1.0F});
  }
  int NumParameters() const override { return static_cast<int>(basis_.size()); }

  Flow flow(const double* parameters) const {
    Flow f = frame_;
    f.a = {};
    for (std::size_t k = 0; k < basis_.size(); ++k)
      for (std::size_t i = 0; i < 8; ++i) f.a[i] += parameters[k] * basis_[k][i] / (frame_.scale * half_s_);
    return f;
  }

  bool Evaluate(const double* parameters, double* cost, double* gradient) const override {
    const Flow f = flow(parameters);
    cv::Mat_<float> picture(binned_, 0.0F);
    Corner c;
    const auto warped = [&](const Vote& v) {
      const cv::Point2d u = f.at(v.x, v.y);
      return corner_at((v.x - u.x * v.t_s) / bin_, (v.y - u.y * v.t_s) / bin_, binned_, c);
    };
    for (const Vote& v : votes_)
      if (warped(v)) vote(picture, c, v.p);
    cv::GaussianBlur(picture, picture, {}, sigma_);
    const double scale = 1.0 / static_cast<double>(votes_.size());
    *cost = -picture.dot(picture) * scale;
    if (!gradient) return true;

    cv::GaussianBlur(picture, picture, {}, sigma_);
    std::fill_n(gradient, basis_.size(), 0.0);
    for (const Vote& v : votes_) {
      if (!warped(v)) continue;
      const float a = picture(c.y, c.x), b = picture(c.y, c.x + 1), d = picture(c.y + 1, c.x),
                  e = picture(c.y + 1, c.x + 1);
      const double by_x = ((b - a) * (1 - c.fy) + (e - d) * c.fy), by_y = ((d - a) * (1 - c.fx) + (e - b) * c.fx);
      const double nx = (v.x - frame_.centre.x) / frame_.scale, ny = (v.y - frame_.centre.y) / frame_.scale;
      const double common = 2 * v.p * scale * v.t_s / half_s_ / bin_;
      for (std::size_t k = 0; k < basis_.size(); ++k) {
        const auto& g = basis_[k];
        gradient[k] += common * (by_x * (g[0] + g[1] * nx + g[2] * ny + nx * (g[6] * nx + g[7] * ny)) +
                                 by_y * (g[3] + g[4] * nx + g[5] * ny + ny * (g[6] * nx + g[7] * ny)));
      }
    }
    return true;
  }

 private:
  struct Vote {
    double x, y, t_s;
    float p;
  };
  Flow frame_;
  Basis basis_;
  double half_s_, sigma_;
  int bin_;
  cv::Size binned_;
  std::vector<Vote> votes_;
};

// Displacement from the first picture to the second [px of the pictures], by cross-correlation of both after a blur.
cv::Point2d displacement(const cv::Mat& first, const cv::Mat& second) {
  cv::Mat a, b, product;
  const cv::Size padded(cv::getOptimalDFTSize(first.cols * 2), cv::getOptimalDFTSize(first.rows * 2));
  for (auto [in, out] : {std::pair{&first, &a}, {&second, &b}}) {
    cv::copyMakeBorder(*in, *out, 0, padded.height - in->rows, 0, padded.width - in->cols, cv::BORDER_CONSTANT, 0);
    cv::dft(*out, *out, 0, in->rows);
  }
  cv::mulSpectrums(b, a, product, 0, true);
  cv::dft(product, product, cv::DFT_INVERSE | cv::DFT_SCALE);
  cv::Point peak;
  cv::minMaxLoc(product, nullptr, nullptr, nullptr, &peak);
  return {double(peak.x > padded.width / 2 ? peak.x - padded.width : peak.x),
          double(peak.y > padded.height / 2 ? peak.y - padded.height : peak.y)};
}

// Centre and scale of Flow: mean and spread of the events.
Flow frame_of(std::span<const Event> events, cv::Size size) {
  cv::Point2d sum(0, 0), squares(0, 0);
  for (const Event& e : events) sum += cv::Point2d(e.x + 0.5, e.y + 0.5);
  Flow f;
  f.centre = sum / static_cast<double>(events.size());
  for (const Event& e : events) {
    const cv::Point2d d = cv::Point2d(e.x + 0.5, e.y + 0.5) - f.centre;
    squares += cv::Point2d(d.x * d.x, d.y * d.y);
  }
  f.scale =
      std::clamp(std::sqrt((squares.x + squares.y) / static_cast<double>(events.size())), 8.0, double(size.width));
  return f;
}

double travel_px(std::span<const Event> events, const Flow& flow, double span_s) {
  double sum = 0;
  const std::size_t step = 1 + events.size() / 5000;
  std::size_t n = 0;
  for (std::size_t i = 0; i < events.size(); i += step, ++n) sum += cv::norm(flow.at(events[i].x, events[i].y));
  return sum / static_cast<double>(n) * span_s;
}

// The best of several initial guesses: the displacement between the window's halves, and rotations.
Flow first_guess(std::span<const Event> events, double t_us, double half_s, const Flow& frame, cv::Size size) {
  const int bin = std::max(1, size.width / kBinnedWidth);
  cv::Mat_<float> halves[2];
  for (auto& h : halves) h = cv::Mat_<float>(size.height / bin + 1, size.width / bin + 1, 0.0F);
  for (const Event& e : events) halves[static_cast<double>(e.t_us) >= t_us](e.y / bin, e.x / bin) += e.p ? 1.0F : -1.0F;
  for (auto& h : halves) cv::GaussianBlur(h, h, {}, 2);
  const cv::Point2d moved =
      displacement(halves[0], halves[1]) * bin;  // within half_s: between the middles of the halves
  std::vector<std::array<double, 4>> guesses = {{0, 0, 0, 0}, {moved.x, moved.y, 0, 0}};
  for (const double turn_px : {-8, -4, -2, 2, 4, 8}) guesses.push_back({0, 0, 0, turn_px});
  const Contrast contrast(events, t_us, half_s, frame, basis_of("similarity"), size, 2);
  double best = 0;
  Flow flow = frame;
  for (const auto& g : guesses) {
    double cost = 0;
    contrast.Evaluate(g.data(), &cost, nullptr);
    if (cost < best) best = cost, flow = contrast.flow(g.data());
  }
  return flow;
}

}  // namespace

cv::Point2d Flow::at(double x, double y) const {
  const double nx = (x - centre.x) / scale, ny = (y - centre.y) / scale, q = a[6] * nx + a[7] * ny;
  return {scale * (a[0] + a[1] * nx + a[2] * ny + nx * q), scale * (a[3] + a[4] * nx + a[5] * ny + ny * q)};
}

std::optional<FlowWindow> estimate_flow(std::span<const Event> events, cv::Size size, double t_us, std::string& why) {
  if (events.size() < kFirstEvents) {
    why = fmt::format("{} events, fewer than {}", events.size(), kFirstEvents);
    return {};
  }
  const auto at = std::ssize(events::between(events, -1e300, t_us));
  const auto count = static_cast<std::ptrdiff_t>(events.size());
  const auto from = std::clamp<std::ptrdiff_t>(at - kFirstEvents / 2, 0, count - kFirstEvents);
  const double begin = static_cast<double>(events.front().t_us), end = static_cast<double>(events.back().t_us) + 1;

  // Finds the shortest window with motion.
  double half_s = static_cast<double>(events[from + kFirstEvents - 1].t_us - events[from].t_us + 2) * 0.5e-6;
  Flow flow;
  for (;; half_s *= 1.6) {
    if (t_us - half_s * 1e6 < begin - 1 || t_us + half_s * 1e6 > end + 1) {
      why = "nothing moves together by some pixels";
      return {};
    }
    const auto window = events::between(events, t_us - half_s * 1e6, t_us + half_s * 1e6);
    const Flow frame = frame_of(window, size);
    flow = first_guess(window, t_us, half_s, frame, size);
    if (travel_px(window, flow, 2 * half_s) >= kLeastTravel_px) break;
  }

  // Chooses a window of the wanted travel (with little rotation, because Flow is linear in time) and fits its flow:
  // a translation first, then kinds with more parameters as long as they raise the contrast.
  const auto first = events::between(events, t_us - half_s * 1e6, t_us + half_s * 1e6);
  half_s = std::min({half_s * kTravel_px / travel_px(first, flow, 2 * half_s), (t_us - begin) * 1e-6 + 1e-6,
                     (end - t_us) * 1e-6 + 1e-6, kMostTurn_rad / std::max(1e-9, std::abs(flow.a[2]))});
  FlowWindow view;
  view.events = events::between(events, t_us - half_s * 1e6, t_us + half_s * 1e6);
  view.t_us = t_us;
  const Flow frame = frame_of(view.events, size);
  const auto contrast_of = [&](const std::vector<double>& x, const std::string& kind, double sigma) {
    double cost = 0;
    Contrast(view.events, t_us, half_s, frame, basis_of(kind), size, sigma).Evaluate(x.data(), &cost, nullptr);
    return -cost;
  };
  const cv::Point2d middle = flow.at(frame.centre.x, frame.centre.y) * half_s;
  const double turn = flow.a[2] * frame.scale * half_s;
  double best = contrast_of({0, 0}, "translation", 1);
  const double still = best;
  std::vector<double> x = {middle.x, middle.y, 0, turn};
  for (const std::string kind : {"translation", "similarity", "homography"}) {
    std::vector<double> trial;
    if (kind == "translation") trial = {x[0], x[1]};
    if (kind == "similarity") trial = {x[0], x[1], x[2], x[3]};
    if (kind == "homography") trial = {x[0], x[1], x[2], x[3], -x[3], x[2], 0, 0};
    for (const double sigma : {2.0, 1.0}) {
      // The problem owns its cost function.
      const ceres::GradientProblem problem(new Contrast(view.events, t_us, half_s, frame, basis_of(kind), size, sigma));
      ceres::GradientProblemSolver::Options options;
      options.logging_type = ceres::SILENT;
      options.max_num_iterations = 25;
      options.function_tolerance = 1e-5;
      ceres::GradientProblemSolver::Summary summary;
      ceres::Solve(options, problem, trial.data(), &summary);
    }
    const double contrast = contrast_of(trial, kind, 1);
    if (contrast > best * 1.003 || (kind == "translation" && contrast > best)) {
      best = contrast;
      view.flow = Contrast(view.events, t_us, half_s, frame, basis_of(kind), size, 1).flow(trial.data());
      view.flow.kind = kind;
    }
    if (kind == "translation") trial.insert(trial.end(), {0, turn});
    if (kind != "homography") x = trial;
  }
  view.contrast_gain = best / still;
  view.travel_px = travel_px(view.events, view.flow, 2 * half_s);
  if (view.flow.kind == "still" || view.contrast_gain < kLeastGain || view.travel_px < kLeastTravel_px / 2) {
    why = fmt::format("no common motion: contrast {:.2f} times that without", view.contrast_gain);
    return {};
  }
  return view;
}

cv::Mat image_of_warped_events(const FlowWindow& view, cv::Size size, int part) {
  cv::Mat_<float> picture(size, 0.0F);
  std::size_t on = 0, i = 0;
  for (const Event& e : view.events) on += e.p;
  // Equalises the sums of ON and OFF: a pixel that brightens darkens again, but the thresholds differ.
  const double off = static_cast<double>(view.events.size() - on);
  const double balance = std::clamp(std::sqrt((off + 1) / (static_cast<double>(on) + 1)), 0.6, 1.6);
  Corner c;
  for (const Event& e : view.events) {
    if (part >= 0 && static_cast<int>(i++ % 2) != part) continue;
    const double x = e.x + 0.5, y = e.y + 0.5, dt_s = (static_cast<double>(e.t_us) - view.t_us) * 1e-6;
    const cv::Point2d u = view.flow.at(x, y);
    if (corner_at(x - u.x * dt_s, y - u.y * dt_s, size, c))
      vote(picture, c, static_cast<float>(e.p ? balance : -1 / balance));
  }
  return picture;
}

cv::Mat log_intensity(const FlowWindow& view, const cv::Mat& polarities) {
  constexpr float kSmooth = 0.02F;
  constexpr int kLevels = 4;
  const double leak = std::pow(4 * CV_PI / polarities.cols, 2);

  struct Level {
    cv::Mat_<float> dx, dy, e;  // (dx, dy) · grad L = e
  };
  std::vector<Level> levels(kLevels);
  for (int k = 0; k < kLevels; ++k) {
    const int f = 1 << k;
    Level& l = levels[k];
    cv::resize(polarities, l.e, {polarities.cols / f, polarities.rows / f}, 0, 0, cv::INTER_AREA);
    l.e *= -f / view.travel_px;
    l.dx.create(l.e.size()), l.dy.create(l.e.size());
    double norm = 0;
    for (const double a : {view.flow.a[0], view.flow.a[3]}) norm += a * a;
    for (const double a : {view.flow.a[1], view.flow.a[2], view.flow.a[4], view.flow.a[5]}) norm += a * a / 2;
    norm = view.flow.scale * std::sqrt(norm);
    for (int y = 0; y < l.e.rows; ++y)
      for (int x = 0; x < l.e.cols; ++x) {
        const cv::Point2d u = view.flow.at((x + 0.5) * f, (y + 0.5) * f) / norm;
        const double limit = std::max(1.0, cv::norm(u) / 3);  // extrapolated flow is unreliable
        l.dx(y, x) = static_cast<float>(u.x / limit), l.dy(y, x) = static_cast<float>(u.y / limit);
        l.e(y, x) /= static_cast<float>(limit);
      }
  }

  // Solves the normal equations by conjugate gradients, coarse to fine; central differences cause no shift.
  cv::Mat_<float> solution(levels.back().e.size(), 0.0F);
  for (int k = kLevels - 1; k >= 0; --k) {
    const Level& l = levels[k];
    const int rows = l.e.rows, cols = l.e.cols;
    const float mu = static_cast<float>(leak * (1 << k) * (1 << k));
    const auto backward = [&](const cv::Mat_<float>& r, cv::Mat_<float>& out) {  // out = gradientᵀ (d r)
      out.create(r.size());
      out.setTo(0);
      for (int y = 1; y + 1 < rows; ++y)
        for (int x = 1; x + 1 < cols; ++x) {
          const float gx = 0.5F * l.dx(y, x) * r(y, x), gy = 0.5F * l.dy(y, x) * r(y, x);
          out(y, x + 1) += gx, out(y, x - 1) -= gx;
          out(y + 1, x) += gy, out(y - 1, x) -= gy;
        }
    };
    cv::Mat_<float> along(l.e.size(), 0.0F), smooth;
    const auto normal = [&](const cv::Mat_<float>& v, cv::Mat_<float>& out) {
      for (int y = 1; y + 1 < rows; ++y)
        for (int x = 1; x + 1 < cols; ++x)
          along(y, x) = 0.5F * (l.dx(y, x) * (v(y, x + 1) - v(y, x - 1)) + l.dy(y, x) * (v(y + 1, x) - v(y - 1, x)));
      backward(along, out);
      cv::Laplacian(v, smooth, CV_32F, 1, 1, 0, cv::BORDER_REPLICATE);
      out += mu * v - kSmooth * smooth;
    };
    if (solution.size() != l.e.size()) cv::resize(solution, solution, l.e.size(), 0, 0, cv::INTER_LINEAR);
    cv::Mat_<float> right, image, residual, step, next;
    backward(l.e, right);
    normal(solution, image);
    residual = right - image;
    step = residual.clone();
    double squares = residual.dot(residual);
    const double enough = 1e-8 * right.dot(right);
    for (int i = 0; i < (k == kLevels - 1 ? 300 : 40) && squares > enough; ++i) {
      normal(step, image);
      const double alpha = squares / std::max(1e-30, step.dot(image));
      solution += static_cast<float>(alpha) * step;
      residual -= static_cast<float>(alpha) * image;
      const double now = residual.dot(residual);
      step = residual + static_cast<float>(now / squares) * step;
      squares = now;
    }
  }
  return solution;
}

}  // namespace pecs::calibration
