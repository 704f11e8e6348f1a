#include "pecs/calibration/disk.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <complex>
#include <cstdint>
#include <functional>
#include <opencv2/core/optim.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

#include "disk_parts.h"
#include "pecs/error.h"

namespace pecs::calibration {
namespace {

using namespace disk;

constexpr std::size_t kMostEvents = 400'000, kCoarseEvents = 30'000, kWideEvents = 20'000;
constexpr int kMostHarmonics = 8;        // up to 16 sectors
constexpr double kLeastCoherence = 0.2;  // noise gives about 1 / sqrt(events)
constexpr int kEighths = 8;
constexpr std::array kWidths = {0.045, 0.022, 0.011, 0.007};  // of the kernels that locate the steps, in periods

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

// ---- coarse search: harmonic m, centre and speed that maximise |sum of polarity · exp(i m phase)| -------------------

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

// About kMostEvents of the events, drawn at random, in random order. The engine's numbers are the same with every
// standard library; those of its distributions and of std::shuffle are not.
std::vector<Sample> samples_of(const events::Recording& recording, const PlaneFromPixel& plane_from_pixel) {
  std::mt19937_64 random(1);
  std::vector<Sample> samples;
  const double span_s = static_cast<double>(recording.span_us) * 1e-6;
  const std::size_t total = recording.events.size();
  for (const auto& e : recording.events)
    if (total <= kMostEvents || random() % total < kMostEvents) {
      cv::Point2d at(e.x + 0.5, e.y + 0.5);
      if (plane_from_pixel) at = plane_from_pixel(at);
      samples.push_back({at.x, at.y, static_cast<double>(e.t_us) * 1e-6 - span_s / 2, e.p});
    }
  for (std::size_t left = samples.size(); left > 1; --left) std::swap(samples[left - 1], samples[random() % left]);
  return samples;
}

// A harmonic with its best centre and speed.
struct Candidate {
  int harmonic = 0;
  double coherence = 0;
  Fit fit{};
  double period_deg() const { return 360.0 / harmonic; }
  std::string text() const {
    return fmt::format("best candidate: {} sectors about ({:.1f}, {:.1f}), {:.1f} deg/s, coherence {:.3f}",
                       2 * harmonic, fit[kX], fit[kY], fit[kSpeed], coherence);
  }
};
Candidate best_candidate(std::span<const Sample> few, double span_s, double reach_px) {
  std::vector<double> xs, ys;
  for (const Sample& s : few) xs.push_back(s.x), ys.push_back(s.y);
  const auto middle = static_cast<std::ptrdiff_t>(few.size() / 2);
  std::nth_element(xs.begin(), xs.begin() + middle, xs.end());
  std::nth_element(ys.begin(), ys.begin() + middle, ys.end());
  const std::array<double, 2> median = {xs[few.size() / 2], ys[few.size() / 2]};
  // All harmonics: at the median of a disk that is partly out of view, any of them may be stronger than the right one.
  std::array<Candidate, kMostHarmonics> found;
  tbb::parallel_for(1, kMostHarmonics + 1, [&](int m) {
    const auto centre = minimise<2>([&](const double* c) { return -coherence(few, m, c[0], c[1], span_s).value; },
                                    median, {reach_px, reach_px}, 80, 1e-4);
    const Coherence c = coherence(few, m, centre[0], centre[1], span_s);
    found[static_cast<std::size_t>(m - 1)] = {m, c.value, {centre[0], centre[1], c.speed_deg_s, 0, 0}};
  });
  return *std::ranges::max_element(found, {}, &Candidate::coherence);
}

// Locates the steps with ever narrower kernels; returns the last result and updates the candidate's fit.
struct StepFit {
  std::array<Step, 2> steps;
  std::vector<Sample> near;
  double width_deg = 0;
};
StepFit locate_steps(std::span<const Sample> samples, Candidate& c, double span_s, const std::string& file) {
  const std::string text = c.text();
  const double period_deg = c.period_deg();
  StepFit step_fit;
  for (const double part : kWidths) {
    step_fit.width_deg = part * period_deg;
    step_fit.steps = steepest(samples, c.fit, period_deg, step_fit.width_deg);
    c.fit[kOnStep] = step_fit.steps[1].phase_deg, c.fit[kOffStep] = step_fit.steps[0].phase_deg;
    step_fit.near = near_steps(samples, c.fit, period_deg, step_fit.width_deg);
    if (step_fit.near.size() < 200 ||
        step_fit.steps[0].contrast < 5 * std::sqrt(static_cast<double>(step_fit.near.size())) / 2)
      throw bad_input(file, "disk", "nothing found (" + text + ")", "sharp edges in the rotating frame");
    const bool last = part == kWidths.back();
    const std::span used(step_fit.near.data(),
                         last ? step_fit.near.size() : std::min(step_fit.near.size(), kWideEvents));
    c.fit = sharpened(used, c.fit, step_fit.steps, period_deg, step_fit.width_deg, span_s);
  }
  return step_fit;
}

// A number from the place of a pixel, the same for all its events.
std::size_t eighth_of(const Sample& s) {
  const auto bits = 31 * std::bit_cast<std::uint64_t>(s.x) + std::bit_cast<std::uint64_t>(s.y);
  return static_cast<std::size_t>(bits * 0x9E3779B97F4A7C15 >> 61);  // of kEighths; multiplicative hashing
}

// The same fit on the events of random eighths of the pixels, for deviations, and on the two halves in time. The
// latencies of a pixel's events have a part that is the same in each turn: more turns do not reduce it.
struct Refits {
  Fit deviation{};
  double first_half_deg_s = 0, second_half_deg_s = 0;
};
Refits refits_of(const StepFit& step_fit, const Candidate& c, double span_s) {
  std::array<std::vector<Sample>, kEighths + 2> parts;
  for (const Sample& s : step_fit.near) {
    parts[eighth_of(s)].push_back(s);
    parts[s.t_s > 0 ? kEighths + 1 : kEighths].push_back(s);
  }
  std::array<Fit, kEighths + 2> fits;
  tbb::parallel_for(0, kEighths + 2, [&](int i) {
    fits[i] = sharpened(parts[i], c.fit, step_fit.steps, c.period_deg(), step_fit.width_deg, span_s);
  });
  Refits out{{}, fits[kEighths][kSpeed], fits[kEighths + 1][kSpeed]};
  for (std::size_t k = 0; k < c.fit.size(); ++k) {
    double squares = 0;
    for (int i = 0; i < kEighths; ++i) squares += (fits[i][k] - c.fit[k]) * (fits[i][k] - c.fit[k]);
    out.deviation[k] = std::sqrt(squares / (kEighths - 1.0) / kEighths);
  }
  return out;
}

// Warns of a change in the rotation: every quarter of the recording must have a similar coherence at the same phase.
void check_quarters(std::span<const Sample> samples, const Candidate& c, double span_s,
                    std::vector<std::string>& warnings) {
  std::array<std::complex<double>, 4> sums{};
  std::array<double, 4> counts{};
  for (const Sample& s : samples) {
    const auto quarter = static_cast<std::size_t>(std::clamp((s.t_s / span_s + 0.5) * 4, 0.0, 3.0));
    counts[quarter] += 1;
    sums[quarter] +=
        (s.p ? 1.0 : -1.0) * std::polar(1.0, c.harmonic * kDegree * phase_deg(s, c.fit[kX], c.fit[kY], c.fit[kSpeed]));
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
      warnings.push_back(fmt::format(
          "the disk does not rotate uniformly: by quarters of the recording {:.0f} {:.0f} {:.0f} {:.0f} events, "
          "coherence {:.2f} {:.2f} {:.2f} {:.2f}",
          counts[0], counts[1], counts[2], counts[3], parts[0], parts[1], parts[2], parts[3]));
      return;
    }
}

// Locates the two edges. In counter-clockwise rotation later events have smaller phases. Events that start at their
// step start at the edge of their polarity; events that end at it are ended by the edge of the other polarity.
void place_edges(std::span<const Sample> samples, const Candidate& c, const std::array<Step, 2>& steps,
                 const Fit& deviation, DetectedDisk& disk) {
  const double direction = c.fit[kSpeed] > 0 ? 1 : -1, period_deg = c.period_deg();
  disk.on_starts_sharply = steps[1].sign * direction < 0;
  disk.off_starts_sharply = steps[0].sign * direction < 0;
  const bool both_at_off = !disk.on_starts_sharply && disk.off_starts_sharply;
  const bool both_at_on = disk.on_starts_sharply && !disk.off_starts_sharply;
  const auto edge = [&](int step, double shift_deg) {
    Measured m{c.fit[step] + shift_deg, deviation[step]};
    if (step == kOnStep ? disk.on_starts_sharply : disk.off_starts_sharply) {
      const Measured begin = burst_begins(samples, c.fit, step == kOnStep, period_deg);
      m.value -= direction * begin.value;
      m.deviation = std::hypot(m.deviation, begin.deviation);
    }
    m.value -= period_deg * std::floor(m.value / period_deg);
    return m;
  };
  disk.on_edge_deg = edge(disk.on_starts_sharply ? kOnStep : kOffStep, both_at_off ? period_deg / 2 : 0);
  disk.off_edge_deg = edge(disk.off_starts_sharply ? kOffStep : kOnStep, both_at_on ? period_deg / 2 : 0);
  if (both_at_off || both_at_on)
    disk.warnings.push_back(fmt::format("only the {} edge is sharp; the other one is computed for equal sectors",
                                        both_at_off ? "OFF" : "ON"));
}

// Outline of the field of view in the disk's plane.
std::vector<cv::Point2f> outline_of(const events::Recording& recording, const PlaneFromPixel& plane_from_pixel) {
  const auto width = static_cast<double>(recording.width), height = static_cast<double>(recording.height);
  const std::array<cv::Point2d, 5> corners = {{{0, 0}, {width, 0}, {width, height}, {0, height}, {0, 0}}};
  constexpr int kParts = 16;
  std::vector<cv::Point2f> outline;
  for (std::size_t i = 0; i < 4; ++i)
    for (int k = 0; k < kParts; ++k) {
      const cv::Point2d at = corners[i] + (corners[i + 1] - corners[i]) * k / kParts;
      outline.emplace_back(plane_from_pixel ? plane_from_pixel(at) : at);
    }
  return outline;
}

// Rejects what moves along a line: it turns about a centre far out of view.
void check_is_near(const Candidate& c, const std::vector<cv::Point2f>& picture, const std::string& file) {
  const cv::Rect box = cv::boundingRect(picture);
  if (std::hypot(c.fit[kX] - box.x - 0.5 * box.width, c.fit[kY] - box.y - 0.5 * box.height) >
      std::hypot(box.width, box.height))
    throw bad_input(file, "disk", "nothing found (" + c.text() + ")", "a centre of rotation in view or near it");
}

// Events behind each edge of a polarity: counted, and expected for equal edges.
struct Shares {
  std::array<std::vector<double>, 2> found, expected;
};
Shares shares_of(std::span<const Sample> samples, const DetectedDisk& disk, double span_s) {
  constexpr double kEarly = 0.1;      // in periods: pixels respond to blurred edges early
  constexpr double kMostTurn = 1080;  // [deg]; after this rotation all edges are seen equally
  const auto edges = static_cast<std::size_t>(disk.sectors / 2);
  const double period_deg = 720.0 / disk.sectors, speed = disk.speed_deg_s.value;
  // The last edge before a pixel at `angle_deg`, when the edges have turned by `turned_deg`.
  const auto edge_of = [&](int p, double angle_deg, double turned_deg) {
    const double ahead = (p ? disk.on_edge_deg : disk.off_edge_deg).value + turned_deg - angle_deg;
    const auto k = static_cast<long>(std::floor((speed > 0 ? ahead : -ahead) / period_deg + kEarly));
    const long m = static_cast<long>(edges);
    return static_cast<std::size_t>((k % m + m) % m);
  };
  Shares shares;
  for (auto* v : {&shares.found, &shares.expected}) v->fill(std::vector<double>(edges));
  std::array<double, 360> seen{};  // events by the pixel's angle: a measure of the visible part of the disk
  for (const Sample& s : samples) {
    const double dx = s.x - disk.centre_x.value, dy = disk.centre_y.value - s.y;
    if (std::hypot(dx, dy) < kLeastRadius_px) continue;
    const double angle = std::atan2(dy, dx) / kDegree;
    shares.found[s.p][edge_of(s.p, angle, speed * s.t_s)] += 1;
    seen[static_cast<std::size_t>(angle + 360) % 360] += 1;
  }
  const double turn = std::min(kMostTurn, std::abs(speed) * span_s) * (speed > 0 ? 1 : -1);
  const int steps = std::max(1, static_cast<int>(std::abs(turn) / 2));
  for (int p = 0; p < 2; ++p) {
    double events = 0, all = 0;
    for (int i = 0; i < steps; ++i)
      for (std::size_t a = 0; a < seen.size(); ++a)
        shares.expected[p][edge_of(p, static_cast<double>(a) + 0.5, turn * ((i + 0.5) / steps - 0.5))] += seen[a];
    for (std::size_t k = 0; k < edges; ++k) events += shares.found[p][k], all += shares.expected[p][k];
    for (double& e : shares.expected[p]) e *= events / std::max(1.0, all);
  }
  return shares;
}

// Rejects patterns that are not sectors. The edges of sectors generate equal numbers of events, as far as they are in
// view, and ON and OFF edges are half a period apart. All events of a spot on a disk come from one of the edges.
void check_sectors(std::span<const Sample> samples, const DetectedDisk& disk, double span_s, const std::string& file) {
  constexpr double kLeastShare = 0.35, kEnough = 50;
  const auto refuse = [&](const std::string& why) {
    throw bad_input(file, "disk",
                    fmt::format("a pattern that rotates at {:.1f} deg/s about ({:.1f}, {:.1f}), but {}",
                                disk.speed_deg_s.value, disk.centre_x.value, disk.centre_y.value, why),
                    "a disk of alternating black and white sectors of equal width");
  };
  const Shares shares = shares_of(samples, disk, span_s);
  for (const std::size_t p : {1, 0})
    for (std::size_t k = 0; k < shares.found[p].size(); ++k)
      if (shares.expected[p][k] > kEnough && shares.found[p][k] < kLeastShare * shares.expected[p][k])
        refuse(fmt::format("one of its {} {} edges has {:.0f} events, where equal edges would have {:.0f}",
                           shares.found[p].size(), p ? "ON" : "OFF", shares.found[p][k], shares.expected[p][k]));
  const double period_deg = 720.0 / disk.sectors;
  const double off = std::remainder(disk.off_edge_deg.value - disk.on_edge_deg.value - period_deg / 2, period_deg);
  if (std::abs(off) > period_deg / 6)
    refuse(fmt::format("its edges are {:.0f} and {:.0f} deg apart alternately", period_deg / 2 + off,
                       period_deg / 2 - off));
}

Json json_of(const Measured& m) { return {{"value", m.value}, {"deviation", m.deviation}}; }

}  // namespace

DetectedDisk find_disk(const events::Recording& recording, const std::string& file,
                       const PlaneFromPixel& plane_from_pixel) {
  const std::vector<Sample> samples = samples_of(recording, plane_from_pixel);
  const double span_s = static_cast<double>(recording.span_us) * 1e-6;
  if (samples.size() < 2000)
    throw bad_input(file, "disk", fmt::format("nothing found: {} events", samples.size()), "at least 2000 events");
  Candidate c =
      best_candidate({samples.data(), std::min(samples.size(), kCoarseEvents)}, span_s, 0.05 * recording.width);
  if (c.coherence < kLeastCoherence)
    throw bad_input(file, "disk", "nothing found (" + c.text() + ")",
                    fmt::format("a coherence of at least {}", kLeastCoherence));
  const StepFit step_fit = locate_steps(samples, c, span_s, file);
  const std::vector<cv::Point2f> picture = outline_of(recording, plane_from_pixel);
  check_is_near(c, picture, file);
  const Refits refits = refits_of(step_fit, c, span_s);

  DetectedDisk disk;
  disk.centre_x = {c.fit[kX], refits.deviation[kX]};
  disk.centre_y = {c.fit[kY], refits.deviation[kY]};
  disk.speed_deg_s = {c.fit[kSpeed], refits.deviation[kSpeed]};
  disk.sectors = 2 * c.harmonic;
  disk.phase_time_us = recording.first_us + recording.span_us / 2;
  disk.coherence = c.coherence;
  disk.events = samples.size();
  const double change = refits.second_half_deg_s - refits.first_half_deg_s;
  if (std::abs(change) > 0.02 * std::abs(c.fit[kSpeed]) && std::abs(change) > 10 * disk.speed_deg_s.deviation)
    disk.warnings.push_back(fmt::format("the speed changes: {:.1f} deg/s in the first half, {:.1f} deg/s in the second",
                                        refits.first_half_deg_s, refits.second_half_deg_s));
  check_quarters(samples, c, span_s, disk.warnings);
  place_edges(samples, c, step_fit.steps, refits.deviation, disk);
  check_sectors(samples, disk, span_s, file);
  find_rim(samples, picture, disk);
  return disk;
}

Json to_json(const DetectedDisk& d) {
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

cv::Mat disk_picture(const events::Recording& recording, const DetectedDisk& disk, const view::Theme& theme) {
  // The window in which the disk rotates by 10 degrees.
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
