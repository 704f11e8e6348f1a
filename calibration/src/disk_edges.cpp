#include <ceres/gradient_problem.h>
#include <ceres/gradient_problem_solver.h>

#include <algorithm>

#include "disk_parts.h"

namespace pecs::calibration::disk {

namespace {

// Derivative of a Gaussian: positive beyond the step.
double kernel(double d_deg, double width_deg) {
  const double u = d_deg / width_deg;
  return std::abs(u) > 5 ? 0 : u * std::exp(-u * u / 2);
}

}  // namespace

std::array<Step, 2> steepest(std::span<const Sample> samples, const Fit& fit, double period_deg, double width_deg) {
  constexpr int kBins = 720, kMiddle = kBins / 2;
  std::array<std::array<double, kBins>, 2> histogram{};
  for (const Sample& s : samples) {
    const double part = wrapped(phase_deg(s, fit[kX], fit[kY], fit[kSpeed]), period_deg) / period_deg + 0.5;
    histogram[s.p][std::min(kBins - 1, static_cast<int>(part * kBins))] += 1;
  }
  std::array<Step, 2> steps;
  const double bin_deg = period_deg / kBins;
  for (int p = 0; p < 2; ++p)
    for (int i = 0; i < kBins; ++i) {
      double sum = 0;
      for (int k = 0; k < kBins; ++k)
        if (histogram[p][k] > 0)
          sum += histogram[p][k] * kernel(wrapped((k + 0.5 - i) * bin_deg, period_deg), width_deg);
      if (std::abs(sum) > steps[p].contrast) steps[p] = {(i - kMiddle) * bin_deg, sum > 0 ? 1.0 : -1.0, std::abs(sum)};
    }
  return steps;
}

std::vector<Sample> near_steps(std::span<const Sample> samples, const Fit& fit, double period_deg, double width_deg) {
  std::vector<Sample> near;
  for (const Sample& s : samples)
    if (std::hypot(s.x - fit[kX], s.y - fit[kY]) > kLeastRadius_px &&
        std::abs(wrapped(phase_deg(s, fit[kX], fit[kY], fit[kSpeed]) - fit[s.p ? kOnStep : kOffStep], period_deg)) <
            6 * width_deg)
      near.push_back(s);
  return near;
}

namespace {

// Minus the sharpness of both steps. Parameters: those of the fit, as multiples of `unit` from `start`, so that all
// have the same magnitude.
class Dullness : public ceres::FirstOrderFunction {
 public:
  Dullness(std::span<const Sample> near, const Fit& start, const std::array<Step, 2>& steps, double period_deg,
           double width_deg, double span_s)
      : near_(near),
        start_(start),
        steps_(steps),
        period_deg_(period_deg),
        width_deg_(width_deg),
        unit_{width_deg, width_deg, width_deg / span_s, width_deg / 2, width_deg / 2} {}
  int NumParameters() const override { return static_cast<int>(unit_.size()); }

  Fit fit(const double* parameters) const {
    Fit f = start_;
    for (std::size_t k = 0; k < f.size(); ++k) f[k] += parameters[k] * unit_[k];
    return f;
  }

  bool Evaluate(const double* parameters, double* cost, double* gradient) const override {
    const Fit f = fit(parameters);
    double sum = 0;
    Fit by{};
    for (const Sample& s : near_) {
      const int step = s.p ? kOnStep : kOffStep;
      const double u = wrapped(phase_deg(s, f[kX], f[kY], f[kSpeed]) - f[step], period_deg_) / width_deg_;
      if (std::abs(u) > 5) continue;
      const double bell = steps_[s.p].sign * std::exp(-u * u / 2), slope = (1 - u * u) * bell / width_deg_;
      sum -= u * bell;
      const double dx = s.x - f[kX], dy = f[kY] - s.y, squared = (dx * dx + dy * dy) * kDegree;
      by[kX] -= slope * dy / squared, by[kY] -= slope * dx / squared;
      by[kSpeed] += slope * s.t_s, by[step] += slope;
    }
    const double scale = 1.0 / static_cast<double>(near_.size());
    *cost = sum * scale;
    if (gradient)
      for (std::size_t k = 0; k < by.size(); ++k) gradient[k] = by[k] * unit_[k] * scale;
    return true;
  }

 private:
  std::span<const Sample> near_;
  Fit start_;
  std::array<Step, 2> steps_;
  double period_deg_, width_deg_;
  Fit unit_;
};

}  // namespace

Fit sharpened(std::span<const Sample> near, const Fit& start, const std::array<Step, 2>& steps, double period_deg,
              double width_deg, double span_s) {
  auto* dullness = new Dullness(near, start, steps, period_deg, width_deg, span_s);
  const ceres::GradientProblem problem(dullness);  // takes ownership
  std::array<double, 5> x{};
  ceres::GradientProblemSolver::Options options;
  options.logging_type = ceres::SILENT;
  options.line_search_direction_type = ceres::BFGS;
  options.max_num_iterations = 60;
  options.function_tolerance = 1e-8;
  ceres::GradientProblemSolver::Summary summary;
  ceres::Solve(options, problem, x.data(), &summary);
  return dullness->fit(x.data());
}

Measured burst_begins(std::span<const Sample> samples, const Fit& fit, int p, double period_deg) {
  constexpr std::size_t kRings = 8;
  constexpr double kBegin = 0.05;  // fraction of a burst's events before its onset: early, but above noise
  const double direction = fit[kSpeed] > 0 ? 1 : -1;
  std::vector<std::pair<double, double>> events;  // radius, delay
  for (const Sample& s : samples) {
    const double r = std::hypot(s.x - fit[kX], s.y - fit[kY]);
    const double late =
        -direction * wrapped(phase_deg(s, fit[kX], fit[kY], fit[kSpeed]) - fit[p ? kOnStep : kOffStep], period_deg);
    if (s.p == p && r > kLeastRadius_px && std::abs(late) < period_deg / 16) events.emplace_back(r, late);
  }
  if (events.size() < 100 * kRings) return {};
  std::sort(events.begin(), events.end());
  // Fits a line to the onsets over 1 / radius; the innermost ring is excluded as too blurred.
  std::array<double, kRings> inverse{}, begin{};
  double mean = 0, mean_begin = 0, squares = 0, slope = 0, left = 0;
  for (std::size_t k = 1; k < kRings; ++k) {
    const std::span ring(events.data() + events.size() * k / kRings, events.data() + events.size() * (k + 1) / kRings);
    for (const auto& e : ring) inverse[k] += 1 / e.first / static_cast<double>(ring.size());
    const auto at = ring.begin() + static_cast<std::ptrdiff_t>(kBegin * static_cast<double>(ring.size()));
    std::nth_element(ring.begin(), at, ring.end(), [](const auto& u, const auto& v) { return u.second < v.second; });
    begin[k] = at->second;
    mean += inverse[k] / (kRings - 1), mean_begin += begin[k] / (kRings - 1);
  }
  for (std::size_t k = 1; k < kRings; ++k) {
    squares += (inverse[k] - mean) * (inverse[k] - mean);
    slope += (inverse[k] - mean) * (begin[k] - mean_begin);
  }
  slope /= squares;
  for (std::size_t k = 1; k < kRings; ++k) {
    const double off = begin[k] - mean_begin - slope * (inverse[k] - mean);
    left += off * off / (kRings - 3);
  }
  return {mean_begin - slope * mean, std::sqrt(left * (1.0 / (kRings - 1) + mean * mean / squares))};
}

}  // namespace pecs::calibration::disk
