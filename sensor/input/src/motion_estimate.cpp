#include "pecs/input/motion_estimate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <mutex>
#include <opencv2/imgproc.hpp>

#include "flow_picture.h"
#include "pecs/input/media.h"
#include "pecs/sensor/motion.h"
#include "pecs/sensor/photocurrent.h"

namespace pecs::input {
namespace {

constexpr float kStill_px = 1;  // shorter motion is none
constexpr int kNear_px = 4;
// A point whose flow there and back ends farther from it than both is astray: occluded, or its flow is wrong.
constexpr float kError_px = 0.3f, kErrorOfMotion = 0.25f;
// Light at both ends of the flow differs by as much as it changes along the motion in this time, or more: events of it
// have no reliable time. Both are means around the point (Gaussian, kAround_px) of at most kMost (in ln); a change of
// less than kLeast counts as that, since it causes no events.
constexpr float kUnsure_us = 25000, kMost = 3;
constexpr double kAround_px = 2.5, kLeast = 0.05;
constexpr float kLight = 0.2f;      // of cuts: astray, and the light at both ends differs by this (in ln)
constexpr double kCut = 0.6;        // share of such points at which nothing is consistent
constexpr float kDarkest = 0.001f;  // of white: darker light counts as this
constexpr float kFast_px = 3;       // blur of shorter motion is not seen
constexpr double kBlurred = 0.6;    // of gradients along the motion to those across it
constexpr double kMuchUnsure = 0.1, kLargeMotion_px = 30;
constexpr std::size_t kFrames = 3, kIntervals = 4;  // that are kept: those of the simulation, and the next
constexpr std::size_t kMostCuts = 100;              // listed

struct Picture {
  std::int64_t frame = 0;
  cv::Mat grey, ln;  // as grey_of; logarithm of the relative light
};

// The estimate of one interval.
struct Estimate {
  std::int64_t frame = 0;
  cv::Mat flow[2];    // from the first frame, and from the second one [px]
  cv::Mat astray[2];  // points
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

// Difference of the light at both ends [ln].
cv::Mat residual(const cv::Mat& there, const cv::Mat& ln_first, const cv::Mat& ln_second) {
  return cv::abs(at_end(ln_second, there, kBeyond) - ln_first);
}

// 255 where the residual has no relation to the change along the motion. Points that leave the picture do not count.
cv::Mat doubtful(const cv::Mat& residual, const cv::Mat& flow, const cv::Mat& ln, double interval_us) {
  cv::Mat gx, gy, xy[2], error, rate;
  cv::Sobel(ln, gx, CV_32F, 1, 0, 3, 1 / 8.0);
  cv::Sobel(ln, gy, CV_32F, 0, 1, 3, 1 / 8.0);
  cv::split(flow, xy);
  const cv::Mat inside = residual < kBeyond / 100;  // light differs by 7 at most
  cv::Mat(cv::min(residual, kMost)).copyTo(error, inside);
  cv::Mat(cv::min(cv::abs(xy[0].mul(gx) + xy[1].mul(gy)), kMost)).copyTo(rate, inside);
  for (cv::Mat* mean : {&error, &rate}) cv::GaussianBlur(*mean, *mean, {}, kAround_px);
  return error * (interval_us / kUnsure_us) > cv::max(rate, kLeast);
}

// 255 within kNear_px of motion by kStill_px.
cv::Mat moving(const cv::Mat& flow) {
  cv::Mat nearby;
  cv::dilate(length_of(flow), nearby, cv::Mat::ones(2 * kNear_px + 1, 2 * kNear_px + 1, CV_8U));
  return nearby >= kStill_px;
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

// Marks the pixels on which the points are, at the middle of each eighth of the interval; the flow is of its first
// frame or of its second.
void mark_paths(const cv::Mat& points, const cv::Mat& flow, bool second, std::vector<std::uint8_t>& out) {
  for (int y = 0; y < flow.rows; ++y)
    for (int x = 0; x < flow.cols; ++x) {
      if (!points.at<std::uint8_t>(y, x)) continue;
      const cv::Point2f d = flow.at<cv::Point2f>(y, x);
      for (int k = 0; k < 8; ++k) {
        const float s = (static_cast<float>(second ? 7 - k : k) + 0.5f) / 8;
        const int px = cvRound(static_cast<float>(x) + s * d.x), py = cvRound(static_cast<float>(y) + s * d.y);
        if (px >= 0 && py >= 0 && px < flow.cols && py < flow.rows)
          out[static_cast<std::size_t>(py) * static_cast<std::size_t>(flow.cols) + static_cast<std::size_t>(px)] |=
              static_cast<std::uint8_t>(1 << k);
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

class EstimatedMotion final : public SourceOfFrames {
 public:
  using SourceOfFrames::SourceOfFrames;

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
    std::vector<float> motion = sensor::motion_of_flow(channels, 4);
    const std::size_t pixels = found.astray[0].total(), path = sensor::kMotionChannels / 2;
    for (std::size_t side = 0; side < 2; ++side)  // depths at start and end
      for (std::size_t i = 0; i < 2 * pixels; ++i)
        motion[(path * (side + 1) - 2) * pixels + i] = found.astray[side].data[i % pixels] ? 2.0f : 1.0f;
    sink(0, info().height, motion);
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

  mutable std::mutex mutex_;
  mutable std::deque<Picture> pictures_;
  mutable std::deque<Estimate> estimates_;
  mutable std::map<std::int64_t, Measures> measures_;  // of all intervals read
};

Picture EstimatedMotion::picture_of(std::int64_t frame, const sensor::RowSink* sink) const {
  const cv::Mat_<float> light = relative_light(*source_, frame, sink);
  Picture out{frame, grey_of(light), {}};
  cv::log(cv::max(light, kDarkest), out.ln);
  return out;
}

const Estimate& EstimatedMotion::estimate(std::int64_t frame) const {
  for (const Estimate& known : estimates_)
    if (known.frame == frame) return known;
  Estimate out;
  out.frame = frame;
  const Picture pictures[2] = {picture(frame), picture(frame + 1)};
  const cv::Size size = pictures[0].grey.size();
  for (int k = 0; k < 2; ++k) {
    if (k == 0 || cv::countNonZero(moving(out.flow[0])))
      out.flow[k] = media().optical_flow(pictures[k].grey, pictures[1 - k].grey);
    else
      out.flow[0] = out.flow[k] = cv::Mat::zeros(size, CV_32FC2);
  }
  for (int k = 0; k < 2; ++k) out.astray[k] = astray(out.flow[k], out.flow[1 - k]);
  std::vector<float> lengths;
  const cv::Mat length = length_of(out.flow[0]);
  for (int y = 0; y < size.height; ++y)
    for (int x = 0; x < size.width; ++x)
      if (!out.astray[0].at<std::uint8_t>(y, x)) lengths.push_back(length.at<float>(y, x));

  Measures& measures = measures_[frame];
  measures.median_px = sensor::quantile(lengths, 0.5);
  measures.largest_px = sensor::quantile(lengths, 0.999);  // single points are errors
  const auto& times_ns = info().times_ns;
  const auto at = static_cast<std::size_t>(frame);
  const double interval_us = 1e-3 * static_cast<double>(times_ns[at + 1] - times_ns[at]);
  cv::Mat doubt[2];
  for (int k = 0; k < 2; ++k) {
    const cv::Mat light = residual(out.flow[k], pictures[k].ln, pictures[1 - k].ln);
    doubt[k] = doubtful(light, out.flow[k], pictures[k].ln, interval_us);
    if (k == 1) continue;
    measures.unreliable = cv::countNonZero(doubt[0]) / static_cast<double>(size.area());
    cv::Mat differs;
    cv::blur(light, differs, {3, 3});
    measures.is_cut = cv::countNonZero((differs > kLight) & out.astray[0]) > kCut * size.area();
  }
  std::vector<std::uint8_t> sure(doubt[0].total());
  out.unsure.assign(doubt[0].total(), measures.is_cut ? 255 : 0);
  for (int k = 0; k < 2; ++k) {
    limit(out.flow[k], out.astray[k], measures.is_cut ? 0 : measures.largest_px);
    const cv::Mat still = measures.is_cut ? cv::Mat(size, CV_8U, 255) : cv::Mat(~moving(out.flow[k]));
    out.flow[k].setTo(cv::Scalar::all(0), still);
    doubt[k].setTo(0, still);
    mark_paths(doubt[k], out.flow[k], k == 1, out.unsure);
    if (cv::countNonZero(doubt[0] | doubt[1])) mark_paths(~(doubt[k] | out.astray[k]), out.flow[k], k == 1, sure);
  }
  for (std::size_t i = 0; i < sure.size() && !measures.is_cut; ++i)
    out.unsure[i] &= static_cast<std::uint8_t>(~sure[i]);
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
  const float median = sensor::quantile(medians, 0.5);
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
