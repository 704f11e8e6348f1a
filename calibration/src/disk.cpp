#include "pecs/calibration/disk.h"

#include <ceres/gradient_problem.h>
#include <ceres/gradient_problem_solver.h>
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <functional>
#include <numbers>
#include <opencv2/core/optim.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

#include "pecs/error.h"

namespace pecs::calibration {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr std::size_t kMostEvents = 400'000, kCoarseEvents = 30'000, kWideEvents = 20'000;
constexpr int kMostHarmonics = 8;        // up to 16 sectors
constexpr double kLeastCoherence = 0.2;  // noise gives about 1 / sqrt(events)
constexpr double kLeastRadius_px = 10;   // nearer to the centre an angle means nothing
constexpr int kEighths = 8;
constexpr std::array kWidths = {0.045, 0.022, 0.011, 0.007};  // of the looks at the steps, parts of the period

struct Sample {
  double x, y, t_s;  // pixel centre; time from the middle of the recording
  int p;
};

// Parameters of a fit: centre, speed and the phases of the two sharp steps (ON events', OFF events').
using Fit = std::array<double, 5>;
enum { kX, kY, kSpeed, kOnStep, kOffStep };

double wrapped(double angle_deg, double period_deg) {  // to [-period/2, period/2)
  return angle_deg - period_deg * std::floor(angle_deg / period_deg + 0.5);
}

// Angle in the frame that turns with the disk.
double phase_deg(const Sample& s, double x, double y, double speed_deg_s) {
  return std::atan2(y - s.y, s.x - x) / kDegree - speed_deg_s * s.t_s;
}

// Minimises f from `start`; `steps` spans the first simplex (Nelder and Mead).
template <std::size_t N>
std::array<double, N> minimise(const std::function<double(const double*)>& f, std::array<double, N> start,
                               std::array<double, N> steps, int most_calls, double tolerance) {
  struct Function : cv::MinProblemSolver::Function {
    const std::function<double(const double*)>& f;
    explicit Function(const std::function<double(const double*)>& g) : f(g) {}
    int getDims() const override { return static_cast<int>(N); }
    double calc(const double* x) const override { return f(x); }
  };
  cv::Mat_<double> x(1, static_cast<int>(N), start.data()), step(1, static_cast<int>(N), steps.data());
  const auto solver = cv::DownhillSolver::create(
      cv::makePtr<Function>(f), step, {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, most_calls, tolerance});
  solver->minimize(x);
  return start;  // x is a view of it
}

// ---- coarse: which harmonic m, centre and speed make polarity · exp(i m phase) add up -------------------------------

struct Coherence {
  double value = 0, speed_deg_s = 0;
};

Coherence coherence(std::span<const Sample> samples, int m, double x, double y, double span_s) {
  const int bins = static_cast<int>(std::clamp(span_s / 0.2e-3, 256.0, 16384.0));
  const int padded = cv::getOptimalDFTSize(8 * bins);
  cv::Mat_<cv::Vec2d> sums(1, padded, cv::Vec2d(0, 0));
  for (const Sample& s : samples) {
    const double angle = m * std::atan2(y - s.y, s.x - x);
    const int bin = std::clamp(static_cast<int>((s.t_s / span_s + 0.5) * bins), 0, bins - 1);
    sums(0, bin) += (s.p ? 1.0 : -1.0) * cv::Vec2d(std::cos(angle), std::sin(angle));
  }
  cv::dft(sums, sums);
  int best = 0;
  for (int i = 0; i < padded; ++i)
    if (cv::norm(sums(0, i)) > cv::norm(sums(0, best))) best = i;
  const double turns =
      (best <= padded / 2 ? best : best - padded) / (padded * span_s / bins);  // per second, of the pattern
  return {cv::norm(sums(0, best)) / static_cast<double>(samples.size()), turns * 360 / m};
}

// ---- fine: the sharp steps of the event density in the turning frame ------------------------------------------------

struct Step {
  double phase_deg = 0, sign = 0, contrast = 0;  // sign +1: density is higher at larger phase
};

// Derivative of a Gaussian: positive beyond the step.
double kernel(double d_deg, double width_deg) {
  const double u = d_deg / width_deg;
  return std::abs(u) > 5 ? 0 : u * std::exp(-u * u / 2);
}

std::array<Step, 2> steepest(std::span<const Sample> samples, const Fit& fit, double period_deg, double width_deg) {
  constexpr int kBins = 720;
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
      if (std::abs(sum) > steps[p].contrast)
        steps[p] = {(i - kBins / 2) * bin_deg, sum > 0 ? 1.0 : -1.0, std::abs(sum)};
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

// Minus the sharpness of both steps. Parameters: the fit's, in units of `unit` from `start`, so that all are of one
// size.
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

// Moves all five parameters to where the two steps are steepest.
Fit sharpened(std::span<const Sample> near, const Fit& start, const std::array<Step, 2>& steps, double period_deg,
              double width_deg, double span_s) {
  auto* dullness = new Dullness(near, start, steps, period_deg, width_deg, span_s);
  const ceres::GradientProblem problem(dullness);  // which owns it
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

// ---- edges of fast pixels -------------------------------------------------------------------------------------------

// Fast pixels answer an edge with a short burst that begins as soon as the blurred edge touches them: ahead of its
// middle by a number of pixels, so by an angle that falls as 1 / radius. Returns where bursts would begin far out,
// degrees behind the step, and its deviation.
Measured burst_begins(std::span<const Sample> samples, const Fit& fit, int p, double period_deg) {
  constexpr std::size_t kRings = 8;
  constexpr double kBegin = 0.05;  // part of a burst: early, yet no stray event
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
  // A line through the rings' 1 / radius and beginnings; the innermost ring is too blurred.
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

// ---- rim ------------------------------------------------------------------------------------------------------------

// `picture`: outline of what the camera sees; events that stop there end no disk.
void find_rim(std::span<const Sample> samples, const std::vector<cv::Point2f>& picture, Disk& disk) {
  constexpr int kWedges = 90, kPerPixel = 4, kReach = 6 * kPerPixel;  // compares 6 px inside with 6 px outside
  constexpr double kLeastContrast = 4.5;                              // standard deviations; chance reaches about 4
  const auto farthest = std::max_element(samples.begin(), samples.end(), [&](const Sample& a, const Sample& b) {
    const double cx = disk.centre_x.value, cy = disk.centre_y.value;
    return std::hypot(a.x - cx, a.y - cy) < std::hypot(b.x - cx, b.y - cy);
  });
  const double far = std::hypot(farthest->x - disk.centre_x.value, farthest->y - disk.centre_y.value);
  const int bins = static_cast<int>(far * kPerPixel) + kReach + 2;
  std::vector<std::vector<double>> events(kWedges, std::vector<double>(bins));  // by radius, then summed up to it
  for (const Sample& s : samples) {
    const double dx = s.x - disk.centre_x.value, dy = s.y - disk.centre_y.value;
    const int wedge =
        std::min(kWedges - 1, static_cast<int>((std::atan2(dy, dx) / (2 * std::numbers::pi) + 0.5) * kWedges));
    events[wedge][static_cast<int>(std::hypot(dx, dy) * kPerPixel)] += 1;
  }

  // In each wedge the outermost radius where events stop: the step that stands out most against chance.
  std::vector<cv::Point2f> points;
  for (int w = 0; w < kWedges; ++w) {
    auto& sum = events[w];
    for (int i = 1; i < bins; ++i) sum[i] += sum[i - 1];
    const double angle = ((w + 0.5) / kWedges - 0.5) * 2 * std::numbers::pi;
    const auto place = [&](double radius) {
      return cv::Point2f(static_cast<float>(disk.centre_x.value + radius * std::cos(angle)),
                         static_cast<float>(disk.centre_y.value + radius * std::sin(angle)));
    };
    int end = bins;
    while (end > 0 && cv::pointPolygonTest(picture, place(static_cast<double>(end) / kPerPixel), false) < 0) --end;
    double best = kLeastContrast;
    int rim = 0;
    for (int i = kReach + 2; i + kReach < end; ++i) {
      const double r = static_cast<double>(i + 1) / kPerPixel, half = 0.5 * kReach / kPerPixel;
      const double inside = sum[i] - sum[i - kReach], outside = (sum[i + kReach] - sum[i]) * (r - half) / (r + half);
      const double contrast = (inside - outside) / std::sqrt(inside + outside + 1);
      if (contrast > best) best = contrast, rim = i + 1;
    }
    if (rim > 0) points.push_back(place(static_cast<double>(rim) / kPerPixel));
  }

  // An ellipse through them, again and again without outliers.
  const auto distance = [&](const cv::Point2f& p) {
    const double a = disk.rim.angle * kDegree, dx = p.x - disk.rim.center.x, dy = p.y - disk.rim.center.y;
    const double u = (dx * std::cos(a) + dy * std::sin(a)) / (disk.rim.size.width / 2);
    const double v = (-dx * std::sin(a) + dy * std::cos(a)) / (disk.rim.size.height / 2);
    return (std::hypot(u, v) - 1) * (disk.rim.size.width + disk.rim.size.height) / 4;
  };
  for (int pass = 0; pass < 4; ++pass) {
    if (points.size() < 20) {
      disk.rim = {};
      disk.warnings.push_back("rim: too few directions with enough events");
      return;
    }
    disk.rim = cv::fitEllipseDirect(points);
    std::vector<double> off;
    for (const auto& p : points) off.push_back(std::abs(distance(p)));
    std::vector<double> sorted = off;
    std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2), sorted.end());
    const double limit = std::max(0.5, 4 * sorted[sorted.size() / 2]);
    std::vector<cv::Point2f> kept;
    double squares = 0;
    for (std::size_t i = 0; i < points.size(); ++i)
      if (off[i] <= limit) kept.push_back(points[i]), squares += off[i] * off[i];
    disk.rim_rms_px = std::sqrt(squares / static_cast<double>(std::max<std::size_t>(1, kept.size())));
    points = std::move(kept);
  }
}

Json json_of(const Measured& m) { return {{"value", m.value}, {"deviation", m.deviation}}; }

}  // namespace

Disk find_disk(const events::Recording& recording, const std::string& file, const PlaceOnPlane& place) {
  // Samples, at random if there are very many.
  std::mt19937_64 random(1);
  std::vector<Sample> samples;
  const double span_s = static_cast<double>(recording.span_us) * 1e-6;
  const double keep = static_cast<double>(kMostEvents) / static_cast<double>(recording.events.size());
  for (const auto& e : recording.events)
    if (keep >= 1 || std::uniform_real_distribution(0.0, 1.0)(random) < keep) {
      cv::Point2d at(e.x + 0.5, e.y + 0.5);
      if (place) at = place(at);
      samples.push_back({at.x, at.y, static_cast<double>(e.t_us) * 1e-6 - span_s / 2, e.p});
    }
  if (samples.size() < 2000)
    throw bad_input(file, "disk", fmt::format("nothing found: {} events", samples.size()), "at least 2000 events");
  std::shuffle(samples.begin(), samples.end(), random);
  const std::span few(samples.data(), std::min(samples.size(), kCoarseEvents));

  // Coarse: the harmonics that add up best about the median event, each with its best centre.
  std::vector<double> xs, ys;
  for (const Sample& s : few) xs.push_back(s.x), ys.push_back(s.y);
  const auto middle = static_cast<std::ptrdiff_t>(few.size() / 2);
  std::nth_element(xs.begin(), xs.begin() + middle, xs.end());
  std::nth_element(ys.begin(), ys.begin() + middle, ys.end());
  const std::array<double, 2> median = {xs[few.size() / 2], ys[few.size() / 2]};
  std::vector<std::pair<double, int>> ranked;
  for (int m = 1; m <= kMostHarmonics; ++m)
    ranked.emplace_back(coherence(few, m, median[0], median[1], span_s).value, m);
  std::sort(ranked.rbegin(), ranked.rend());
  int harmonic = 0;
  Coherence best;
  Fit fit{};
  for (int i = 0; i < 3; ++i) {
    const int m = ranked[i].second;
    const double reach = 0.05 * recording.width;
    const auto centre = minimise<2>([&](const double* c) { return -coherence(few, m, c[0], c[1], span_s).value; },
                                    median, {reach, reach}, 80, 1e-4);
    const Coherence c = coherence(few, m, centre[0], centre[1], span_s);
    if (c.value > best.value) best = c, harmonic = m, fit = {centre[0], centre[1], c.speed_deg_s, 0, 0};
  }
  const std::string candidate =
      fmt::format("best candidate: {} sectors about ({:.1f}, {:.1f}), {:.1f} deg/s, coherence {:.3f}", 2 * harmonic,
                  fit[kX], fit[kY], fit[kSpeed], best.value);
  if (best.value < kLeastCoherence)
    throw bad_input(file, "disk", "nothing found (" + candidate + ")",
                    fmt::format("a coherence of at least {}", kLeastCoherence));

  // Fine: ever narrower looks at the steps.
  const double period_deg = 360.0 / harmonic;
  std::array<Step, 2> steps;
  std::vector<Sample> near;
  double width_deg = 0;
  for (const double part : kWidths) {
    width_deg = part * period_deg;
    steps = steepest(samples, fit, period_deg, width_deg);
    fit[kOnStep] = steps[1].phase_deg, fit[kOffStep] = steps[0].phase_deg;
    near = near_steps(samples, fit, period_deg, width_deg);
    if (near.size() < 200 || steps[0].contrast < 5 * std::sqrt(static_cast<double>(near.size())) / 2)
      throw bad_input(file, "disk", "nothing found (" + candidate + ")", "edges that stand out in the turning frame");
    const bool last = width_deg == kWidths.back() * period_deg;
    const std::span used(near.data(), last ? near.size() : std::min(near.size(), kWideEvents));
    fit = sharpened(used, fit, steps, period_deg, width_deg, span_s);
  }

  // How sure: the same fit on random eighths; how steady: on the two halves in time.
  std::array<std::vector<Sample>, kEighths> eighths;
  std::array<std::vector<Sample>, 2> halves;
  for (std::size_t i = 0; i < near.size(); ++i) {
    eighths[i % kEighths].push_back(near[i]);
    halves[near[i].t_s > 0].push_back(near[i]);
  }
  std::array<Fit, kEighths + 2> refits;
  tbb::parallel_for(0, kEighths + 2, [&](int i) {
    const auto& part = i < kEighths ? eighths[i] : halves[i - kEighths];
    refits[i] = sharpened(part, fit, steps, period_deg, width_deg, span_s);
  });
  std::array<double, 5> squares{};
  for (int i = 0; i < kEighths; ++i)
    for (std::size_t k = 0; k < fit.size(); ++k) squares[k] += (refits[i][k] - fit[k]) * (refits[i][k] - fit[k]);
  const auto measured = [&](int k) { return Measured{fit[k], std::sqrt(squares[k] / (kEighths - 1.0) / kEighths)}; };

  Disk disk;
  disk.centre_x = measured(kX), disk.centre_y = measured(kY), disk.speed_deg_s = measured(kSpeed);
  disk.sectors = 2 * harmonic;
  disk.phase_time_us = recording.first_us + recording.span_us / 2;
  disk.coherence = best.value;
  disk.events = samples.size();
  const double first_half = refits[kEighths][kSpeed], second_half = refits[kEighths + 1][kSpeed];
  const double change = second_half - first_half;
  if (std::abs(change) > 0.02 * std::abs(fit[kSpeed]) && std::abs(change) > 10 * disk.speed_deg_s.deviation)
    disk.warnings.push_back(fmt::format("the speed changes: {:.1f} deg/s in the first half, {:.1f} deg/s in the second",
                                        first_half, second_half));

  // Does it turn so throughout: polarities must add up in every quarter of the recording, at the same phase.
  std::array<std::complex<double>, 4> sums{};
  std::array<double, 4> counts{};
  for (const Sample& s : samples) {
    const auto quarter = static_cast<std::size_t>(std::clamp((s.t_s / span_s + 0.5) * 4, 0.0, 3.0));
    counts[quarter] += 1;
    sums[quarter] +=
        (s.p ? 1.0 : -1.0) * std::polar(1.0, harmonic * kDegree * phase_deg(s, fit[kX], fit[kY], fit[kSpeed]));
  }
  const auto strongest =
      *std::max_element(sums.begin(), sums.end(), [](auto a, auto b) { return std::abs(a) < std::abs(b); });
  std::array<double, 4> parts;
  double most = 0;
  for (std::size_t q = 0; q < 4; ++q) {
    parts[q] = std::real(sums[q] * std::conj(strongest)) / std::abs(strongest) / std::max(1.0, counts[q]);
    most = std::max(most, parts[q]);
  }
  const double average = static_cast<double>(samples.size()) / 4;
  for (std::size_t q = 0; q < 4; ++q)
    if (parts[q] < 0.5 * most || counts[q] < 0.2 * average) {
      disk.warnings.push_back(fmt::format(
          "the disk does not turn so throughout: by quarters of the recording {:.0f} {:.0f} {:.0f} {:.0f} events, "
          "coherence {:.2f} {:.2f} {:.2f} {:.2f}",
          counts[0], counts[1], counts[2], counts[3], parts[0], parts[1], parts[2], parts[3]));
      break;
    }

  // Later events lie at smaller phases (counter-clockwise). Events that begin at their step begin at their own edge;
  // events that end there are ended by the edge of the other polarity.
  const double direction = fit[kSpeed] > 0 ? 1 : -1;
  disk.on_starts_sharply = steps[1].sign * direction < 0;
  disk.off_starts_sharply = steps[0].sign * direction < 0;
  const bool both_at_off = !disk.on_starts_sharply && disk.off_starts_sharply;
  const bool both_at_on = disk.on_starts_sharply && !disk.off_starts_sharply;
  const auto edge = [&](int step, double shift_deg) {
    Measured m = measured(step);
    m.value += shift_deg;
    if (step == kOnStep ? disk.on_starts_sharply : disk.off_starts_sharply) {
      const Measured begin = burst_begins(samples, fit, step == kOnStep, period_deg);
      m.value -= direction * begin.value;
      m.deviation = std::hypot(m.deviation, begin.deviation);
    }
    m.value -= period_deg * std::floor(m.value / period_deg);
    return m;
  };
  disk.on_edge_deg = edge(disk.on_starts_sharply ? kOnStep : kOffStep, both_at_off ? period_deg / 2 : 0);
  disk.off_edge_deg = edge(disk.off_starts_sharply ? kOffStep : kOnStep, both_at_on ? period_deg / 2 : 0);
  if (both_at_off || both_at_on)
    disk.warnings.push_back(fmt::format("only the {} edge is sharp; the other one is taken from equal sectors",
                                        both_at_off ? "OFF" : "ON"));

  std::vector<cv::Point2f> picture;
  const auto width = static_cast<double>(recording.width), height = static_cast<double>(recording.height);
  const std::array<cv::Point2d, 5> corners = {{{0, 0}, {width, 0}, {width, height}, {0, height}, {0, 0}}};
  constexpr int kParts = 16;
  for (std::size_t i = 0; i < 4; ++i)
    for (int k = 0; k < kParts; ++k) {
      const cv::Point2d at = corners[i] + (corners[i + 1] - corners[i]) * k / kParts;
      picture.emplace_back(place ? place(at) : at);
    }
  find_rim(samples, picture, disk);
  return disk;
}

Json to_json(const Disk& d) {
  const bool rim = d.rim.size.width > 0;
  return {{"centre_x", json_of(d.centre_x)},
          {"centre_y", json_of(d.centre_y)},
          {"speed_deg_s", json_of(d.speed_deg_s)},
          {"sectors", d.sectors},
          {"phase_time_us", d.phase_time_us},
          {"on_edge_deg", json_of(d.on_edge_deg)},
          {"off_edge_deg", json_of(d.off_edge_deg)},
          {"on_starts_sharply", d.on_starts_sharply},
          {"off_starts_sharply", d.off_starts_sharply},
          {"rim", rim ? Json{{"centre_x", d.rim.center.x},
                             {"centre_y", d.rim.center.y},
                             {"axis_a_px", d.rim.size.width},
                             {"axis_b_px", d.rim.size.height},
                             {"angle_deg", d.rim.angle},
                             {"rms_px", d.rim_rms_px}}
                      : Json(nullptr)},
          {"coherence", d.coherence},
          {"events", d.events},
          {"warnings", d.warnings}};
}

cv::Mat disk_picture(const events::Recording& recording, const Disk& disk, const view::Theme& theme) {
  // A window in which the disk turns 10 degrees.
  const std::int64_t middle = disk.phase_time_us - recording.first_us;
  const auto window = static_cast<std::int64_t>(10 / std::abs(disk.speed_deg_s.value) * 1e6) + 1;
  const int times = std::max(1, 1280 / recording.width);
  cv::Mat picture;
  cv::resize(view::event_frame(recording, middle - window / 2, middle + window / 2, theme), picture, {}, times, times,
             cv::INTER_NEAREST);

  const cv::Scalar ink(theme.ink.b, theme.ink.g, theme.ink.r);
  const auto at = [&](double x, double y) { return cv::Point(cvRound(x * times), cvRound(y * times)); };
  const double cx = disk.centre_x.value, cy = disk.centre_y.value;
  cv::drawMarker(picture, at(cx, cy), ink, cv::MARKER_CROSS, 14, 1, cv::LINE_AA);
  double radius = 0.1 * recording.width;
  if (disk.rim.size.width > 0) {
    cv::RotatedRect rim = disk.rim;
    rim.center *= times, rim.size.width *= static_cast<float>(times), rim.size.height *= static_cast<float>(times);
    cv::ellipse(picture, rim, ink, 1, cv::LINE_AA);
    radius = (disk.rim.size.width + disk.rim.size.height) / 4;
  }
  for (const auto& [edge, colour] : {std::pair{disk.on_edge_deg, theme.on}, {disk.off_edge_deg, theme.off}})
    for (int i = 0; i < disk.sectors / 2; ++i) {
      const double angle = (edge.value + 720.0 * i / disk.sectors) * kDegree;
      cv::line(picture, at(cx, cy), at(cx + radius * std::cos(angle), cy - radius * std::sin(angle)),
               {double(colour.b), double(colour.g), double(colour.r)}, 2, cv::LINE_AA);
    }
  return picture;
}

}  // namespace pecs::calibration
