#include "pecs/input/motion_estimate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <mutex>
#include <opencv2/imgproc.hpp>

#include "pecs/input/media.h"
#include "pecs/sensor/motion.h"

namespace pecs::input {
namespace {

constexpr float kStill_px = 1;  // shorter motion is none
constexpr int kNear_px = 4;
// A point whose flow there and back ends farther from it than both has no reliable motion, if the light at both ends
// also differs by kLight (in ln, mean of 3x3 pixels): on plain surfaces, errors of flow do not matter.
constexpr float kError_px = 0.3f, kErrorOfMotion = 0.25f, kLight = 0.2f;
constexpr double kCut = 0.6;       // share of unreliable points at which nothing is consistent
constexpr float kDarkest = 0.01f;  // of white: darker light counts as this
constexpr float kFast_px = 3;      // blur of shorter motion is not seen
constexpr double kBlurred = 0.6;   // of gradients along the motion to those across it
constexpr double kMuchUnsure = 0.1, kLargeMotion_px = 30;
constexpr std::size_t kFrames = 3, kIntervals = 4;  // that are kept: those of the simulation, and the next
constexpr std::size_t kMostCuts = 100;              // listed

// Of one frame, relative to its own white: fading light does not move.
struct Picture {
  std::int64_t frame = 0;
  cv::Mat grey, ln;  // 8 bits, of gamma 2; logarithm
};

// Of one interval.
struct Estimate {
  std::int64_t frame = 0;
  cv::Mat flow[2];  // from the first frame, and from the second one [px]
  std::vector<std::uint8_t> unsure{};
};

struct Measures {
  float median_px = 0, largest_px = 0;  // of points whose flow returns
  double unreliable = 0;                // share of the points
  bool is_cut = false;
  double along = 0, across = 0;  // gradients of points that move fast, along the motion and across it
};

cv::Mat length_of(const cv::Mat& flow) {
  cv::Mat xy[2], length;
  cv::split(flow, xy);
  cv::magnitude(xy[0], xy[1], length);
  return length;
}

// Values at the ends of the flow; `beyond` outside the picture.
cv::Mat at_end(const cv::Mat& values, const cv::Mat& flow, double beyond) {
  cv::Mat ends(flow.size(), CV_32FC2), out;
  for (int y = 0; y < flow.rows; ++y)
    for (int x = 0; x < flow.cols; ++x)
      ends.at<cv::Point2f>(y, x) =
          cv::Point2f(static_cast<float>(x), static_cast<float>(y)) + flow.at<cv::Point2f>(y, x);
  cv::remap(values, out, ends, {}, cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar::all(beyond));
  return out;
}

constexpr double kBeyond = 1e3;

// 255 where the flow of points of the first frame, there and back, does not return to them.
cv::Mat astray(const cv::Mat& there, const cv::Mat& back) {
  const cv::Mat error = length_of(there + at_end(back, there, kBeyond));
  return (error > kError_px) & (error > kErrorOfMotion * length_of(there));
}

// 255 where the light at both ends differs.
cv::Mat differs(const cv::Mat& there, const cv::Mat& ln_first, const cv::Mat& ln_second) {
  cv::Mat light = cv::abs(at_end(ln_second, there, kBeyond) - ln_first);
  cv::blur(light, light, {3, 3});
  return light > kLight;
}

// Shortens the flow of points.
void limit(cv::Mat& flow, const cv::Mat& points, float most_px) {
  for (int y = 0; y < flow.rows; ++y)
    for (int x = 0; x < flow.cols; ++x) {
      cv::Point2f& d = flow.at<cv::Point2f>(y, x);
      const float length = std::hypot(d.x, d.y);
      if (points.at<std::uint8_t>(y, x) && length > most_px) d *= most_px / length;
    }
}

// Marks the pixels on the paths of the points.
void mark_paths(const cv::Mat& points, const cv::Mat& flow, std::vector<std::uint8_t>& out) {
  for (int y = 0; y < flow.rows; ++y)
    for (int x = 0; x < flow.cols; ++x) {
      if (!points.at<std::uint8_t>(y, x)) continue;
      const cv::Point2f d = flow.at<cv::Point2f>(y, x);
      const int steps = static_cast<int>(std::ceil(std::max(std::abs(d.x), std::abs(d.y)))) + 1;
      for (int k = 0; k <= steps; ++k) {
        const float s = static_cast<float>(k) / static_cast<float>(steps);
        const int px = cvRound(static_cast<float>(x) + s * d.x), py = cvRound(static_cast<float>(y) + s * d.y);
        if (px >= 0 && py >= 0 && px < flow.cols && py < flow.rows)
          out[static_cast<std::size_t>(py) * static_cast<std::size_t>(flow.cols) + static_cast<std::size_t>(px)] = 1;
      }
    }
}

// Motion during the exposure of a frame blurs along the motion alone.
void add_gradients(const cv::Mat& grey, const cv::Mat& flow, Measures& measures) {
  cv::Mat gx, gy;
  cv::Sobel(grey, gx, CV_32F, 1, 0);
  cv::Sobel(grey, gy, CV_32F, 0, 1);
  for (int y = 0; y < flow.rows; ++y)
    for (int x = 0; x < flow.cols; ++x) {
      const cv::Point2f d = flow.at<cv::Point2f>(y, x), g(gx.at<float>(y, x), gy.at<float>(y, x));
      const float length = std::hypot(d.x, d.y);
      if (length < kFast_px) continue;
      measures.along += std::abs(g.dot(d)) / length;
      measures.across += std::abs(g.cross(d)) / length;
    }
}

float quantile(std::vector<float> values, double part) {
  if (values.empty()) return 0;
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(part * static_cast<double>(values.size() - 1));
  std::ranges::nth_element(values, at);
  return *at;
}

class EstimatedMotion final : public sensor::FrameSource {
 public:
  explicit EstimatedMotion(std::unique_ptr<sensor::FrameSource> frames) : source_(std::move(frames)) {}
  const sensor::StackInfo& info() const override { return source_->info(); }
  std::int64_t frames() const override { return source_->frames(); }
  std::string name() const override { return source_->name(); }
  std::string layout() const override { return source_->layout(); }
  void will_read(std::int64_t index) const override { source_->will_read(index); }

  void read_rows(std::int64_t index, const sensor::RowSink& sink, int begin, int end) const override {
    if (begin != 0 || (end != 0 && end != info().height)) return source_->read_rows(index, sink, begin, end);
    Picture read = picture_of(index, &sink);
    const std::scoped_lock lock(mutex_);
    keep(std::move(read));
  }

  bool has_motion() const override { return true; }
  bool estimates_motion() const override { return true; }
  void read_motion(std::int64_t frame, const sensor::RowSink& sink) const override {
    const std::scoped_lock lock(mutex_);
    const Estimate& found = estimate(frame);
    std::vector<float> channels;
    for (const cv::Mat& flow : found.flow)
      for (int c = 0; c < 2; ++c) {
        cv::Mat one;
        cv::extractChannel(flow, one, c);
        channels.insert(channels.end(), one.begin<float>(), one.end<float>());
      }
    sink(0, info().height, sensor::motion_of_flow(channels, 4));
  }
  std::vector<std::uint8_t> unsure(std::int64_t frame) const override {
    const std::scoped_lock lock(mutex_);
    return estimate(frame).unsure;
  }
  sensor::SourceReport report() const override;

 private:
  // Reads a frame, also into the sink.
  Picture picture_of(std::int64_t frame, const sensor::RowSink* sink = nullptr) const;
  const Picture& keep(Picture read) const {
    for (const Picture& known : pictures_)
      if (known.frame == read.frame) return known;
    if (pictures_.size() == kFrames) pictures_.pop_front();
    return pictures_.emplace_back(std::move(read));
  }
  Picture picture(std::int64_t frame) const {
    for (const Picture& known : pictures_)
      if (known.frame == frame) return known;
    return keep(picture_of(frame));
  }
  const Estimate& estimate(std::int64_t frame) const;

  std::unique_ptr<sensor::FrameSource> source_;
  mutable std::mutex mutex_;
  mutable std::deque<Picture> pictures_;
  mutable std::deque<Estimate> estimates_;
  mutable std::map<std::int64_t, Measures> measures_;  // of all intervals read
};

Picture EstimatedMotion::picture_of(std::int64_t frame, const sensor::RowSink* sink) const {
  cv::Mat_<float> light(info().height, info().width, 0.0f);  // mean of the bands
  source_->read_rows(frame, [&](int y, int rows, std::span<const float> values) {
    if (sink) (*sink)(y, rows, values);
    const std::size_t plane = static_cast<std::size_t>(rows) * static_cast<std::size_t>(light.cols);
    const auto bands = static_cast<float>(values.size() / plane);
    float* to = light[y];
    for (std::size_t i = 0; i < values.size(); ++i)
      if (std::isfinite(values[i])) to[i % plane] += std::max(0.0f, values[i]) / bands;
  });
  light /= std::max(quantile({light.begin(), light.end()}, 0.995), 1e-20f);
  Picture out{frame, {}, {}};
  cv::sqrt(cv::min(light, 1), out.grey);
  out.grey.convertTo(out.grey, CV_8U, 255);
  cv::log(cv::max(light, kDarkest), out.ln);
  return out;
}

const Estimate& EstimatedMotion::estimate(std::int64_t frame) const {
  for (const Estimate& known : estimates_)
    if (known.frame == frame) return known;
  Estimate out{frame, {}};
  const Picture pictures[2] = {picture(frame), picture(frame + 1)};
  for (int k = 0; k < 2; ++k) out.flow[k] = media().optical_flow(pictures[k].grey, pictures[1 - k].grey);
  const cv::Mat wrong[2] = {astray(out.flow[0], out.flow[1]), astray(out.flow[1], out.flow[0])};
  std::vector<float> lengths;
  const cv::Mat length = length_of(out.flow[0]);
  for (int y = 0; y < length.rows; ++y)
    for (int x = 0; x < length.cols; ++x)
      if (!wrong[0].at<std::uint8_t>(y, x)) lengths.push_back(length.at<float>(y, x));

  Measures& measures = measures_[frame];
  measures.median_px = quantile(lengths, 0.5);
  measures.largest_px = quantile(lengths, 0.999);  // single points are errors
  cv::Mat bad[2];
  for (int k = 0; k < 2; ++k) bad[k] = wrong[k] & differs(out.flow[k], pictures[k].ln, pictures[1 - k].ln);
  measures.unreliable = cv::countNonZero(bad[0]) / static_cast<double>(bad[0].total());
  measures.is_cut = measures.unreliable > kCut;
  out.unsure.assign(bad[0].total(), measures.is_cut ? 1 : 0);
  for (int k = 0; k < 2; ++k) {
    limit(out.flow[k], wrong[k], measures.is_cut ? 0 : measures.largest_px);
    cv::Mat nearby;
    cv::dilate(length_of(out.flow[k]), nearby, cv::Mat::ones(2 * kNear_px + 1, 2 * kNear_px + 1, CV_8U));
    const cv::Mat still = measures.is_cut ? cv::Mat(nearby >= 0) : cv::Mat(nearby < kStill_px);
    out.flow[k].setTo(cv::Scalar::all(0), still);
    bad[k].setTo(0, still);
    mark_paths(bad[k], out.flow[k], out.unsure);
  }
  add_gradients(pictures[0].grey, out.flow[0], measures);
  if (estimates_.size() == kIntervals) estimates_.pop_front();
  return estimates_.emplace_back(std::move(out));
}

sensor::SourceReport EstimatedMotion::report() const {
  const std::scoped_lock lock(mutex_);
  std::vector<float> medians;
  std::vector<std::int64_t> cuts;
  double unreliable = 0, along = 0, across = 0;
  std::pair<float, std::int64_t> largest{0, 0};
  for (const auto& [frame, m] : measures_) {
    if (m.is_cut) {
      cuts.push_back(frame);
      continue;
    }
    medians.push_back(m.median_px);
    unreliable += m.unreliable;
    along += m.along;
    across += m.across;
    if (m.largest_px > largest.first) largest = {m.largest_px, frame};
  }
  if (!medians.empty()) unreliable /= static_cast<double>(medians.size());
  const float median = quantile(medians, 0.5);
  sensor::SourceReport out = source_->report();
  if (measures_.empty()) return out;
  out.results["motion_estimate"] = {
      {"median_px", median},
      {"largest_px", largest.first},
      {"frame_of_largest", largest.second},
      {"unreliable_share", unreliable},
      {"cuts", std::vector(cuts.begin(), cuts.begin() + std::min<std::ptrdiff_t>(std::ssize(cuts), kMostCuts))},
      {"number_of_cuts", cuts.size()}};
  const auto warn = [&]<class... T>(fmt::format_string<T...> text, T&&... values) {
    out.warnings.push_back(name() + ": " + fmt::format(text, std::forward<T>(values)...));
  };
  if (unreliable > kMuchUnsure || largest.first > kLargeMotion_px)
    warn(
        "pictures move by {:.1f} px from frame to frame (median), by {:.0f} at most (after frame {}), and {:.1f} % of "
        "the picture has no reliable motion; a higher frame rate has less",
        median, largest.first, largest.second, 100 * unreliable);
  if (along < kBlurred * across)
    warn(
        "light varies {:.2f} times as much along the motion as across it: the exposures blur moving edges, and their "
        "events last longer than those of a camera; a shorter exposure has less",
        along / across);
  if (!cuts.empty())
    warn("{} cuts, the first after frame {}: light is interpolated in place there; simulate the shots one by one",
         cuts.size(), cuts.front());
  return out;
}

}  // namespace

std::unique_ptr<sensor::FrameSource> with_estimated_motion(std::unique_ptr<sensor::FrameSource> frames) {
  return std::make_unique<EstimatedMotion>(std::move(frames));
}

}  // namespace pecs::input
