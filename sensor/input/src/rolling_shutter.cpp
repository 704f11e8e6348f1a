#include "rolling_shutter.h"

#include <algorithm>
#include <deque>
#include <mutex>
#include <opencv2/imgproc.hpp>

#include "flow_picture.h"
#include "pecs/input/media.h"

namespace pecs::input {
namespace {

constexpr std::size_t kFramesKept = 4;  // three for a frame, and the one before
constexpr int kSteps = 5;               // of the search for the point that moves to a pixel
const cv::Mat kAround = cv::Mat::ones(3, 3, CV_8U);

cv::Mat at(const cv::Mat& values, const cv::Mat& places, int interpolation) {
  cv::Mat out;
  cv::remap(values, out, places, {}, interpolation, cv::BORDER_REPLICATE);
  return out;
}

class GlobalShutter final : public SourceOfFrames {
 public:
  GlobalShutter(std::unique_ptr<sensor::FrameSource> frames, double row_us)
      : SourceOfFrames(std::move(frames)), row_us_(row_us) {}

  void read_rows(std::int64_t index, const sensor::RowSink& sink, int begin, int end) const override {
    if (end == 0) end = info().height;
    std::vector<float> out;
    {
      const std::scoped_lock lock(mutex_);
      const cv::Mat from = origins(index).rowRange(begin, end);
      for (const cv::Mat& band : frame(index).bands) {
        cv::Mat warped = at(band, from, cv::INTER_CUBIC), least, most;
        // Within the light around: next to a bright edge, a cubic falls to 0, which is a step of many thresholds.
        cv::erode(band, least, kAround);
        cv::dilate(band, most, kAround);
        warped = cv::min(cv::max(warped, at(least, from, cv::INTER_NEAREST)), at(most, from, cv::INTER_NEAREST));
        out.insert(out.end(), warped.begin<float>(), warped.end<float>());
      }
    }
    sink(begin, end - begin, out);
  }

 private:
  struct Frame {
    std::int64_t index = 0;
    std::vector<cv::Mat> bands{};
    cv::Mat grey{};
  };
  const Frame& frame(std::int64_t index) const;
  cv::Mat displacement(std::int64_t index) const;
  cv::Mat origins(std::int64_t index) const;
  double t_us(std::int64_t index) const {
    return 1e-3 * static_cast<double>(info().times_ns[static_cast<std::size_t>(index)]);
  }

  double row_us_;
  mutable std::mutex mutex_;
  mutable std::deque<Frame> frames_;
};

const GlobalShutter::Frame& GlobalShutter::frame(std::int64_t index) const {
  for (const Frame& known : frames_)
    if (known.index == index) return known;
  Frame read{index};
  for (std::size_t k = 0; k < info().bands.size(); ++k) read.bands.emplace_back(info().height, info().width, CV_32F);
  const sensor::RowSink keep = [&](int y, int rows, std::span<const float> values) {
    const std::size_t plane = values.size() / read.bands.size();
    for (std::size_t k = 0; k < read.bands.size(); ++k)
      std::ranges::copy(values.subspan(k * plane, plane), read.bands[k].rowRange(y, y + rows).begin<float>());
  };
  read.grey = grey_of(relative_light(*source_, index, &keep));
  if (frames_.size() == kFramesKept) frames_.pop_front();
  return frames_.emplace_back(std::move(read));
}

// The displacement of each point from its row's time to that of the middle row [px].
cv::Mat GlobalShutter::displacement(std::int64_t index) const {
  cv::Mat flow[2];             // to the frame before, and to the one after
  double interval_us[2] = {};  // negative: before
  for (int k = 0; k < 2; ++k) {
    const std::int64_t other = index + (k ? 1 : -1);
    if (other < 0 || other >= frames()) continue;
    const cv::Mat own = frame(index).grey;
    flow[k] = media().optical_flow(own, frame(other).grey);
    interval_us[k] = t_us(other) - t_us(index);
  }
  cv::Mat out = cv::Mat::zeros(info().height, info().width, CV_32FC2);
  for (int y = 0; y < out.rows; ++y) {
    const double wait_us = row_us_ * (0.5 * (out.rows - 1) - y);
    const int preferred = wait_us < 0 ? 0 : 1, k = flow[preferred].empty() ? 1 - preferred : preferred;
    for (int x = 0; x < out.cols && !flow[k].empty(); ++x) {
      const cv::Point2f d = flow[k].at<cv::Point2f>(y, x);
      // The point is in another row of the other frame.
      out.at<cv::Point2f>(y, x) = d * static_cast<float>(wait_us / (interval_us[k] + row_us_ * d.y));
    }
  }
  return out;
}

// Places in the frame whose points are at the pixels when the middle row is exposed.
cv::Mat GlobalShutter::origins(std::int64_t index) const {
  const cv::Mat moved = displacement(index);
  cv::Mat pixels(moved.size(), CV_32FC2), out;
  for (int y = 0; y < pixels.rows; ++y)
    for (int x = 0; x < pixels.cols; ++x) pixels.at<cv::Point2f>(y, x) = {static_cast<float>(x), static_cast<float>(y)};
  out = pixels.clone();
  for (int step = 0; step < kSteps; ++step) out = pixels - at(moved, out, cv::INTER_LINEAR);
  return out;
}

}  // namespace

std::unique_ptr<sensor::FrameSource> with_global_shutter(std::unique_ptr<sensor::FrameSource> frames, double row_us) {
  return std::make_unique<GlobalShutter>(std::move(frames), row_us);
}

}  // namespace pecs::input
