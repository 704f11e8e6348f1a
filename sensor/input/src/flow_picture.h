#pragma once
// Sources of frames behind others, and the picture of a frame that optical flow takes.
#include <memory>
#include <opencv2/core.hpp>

#include "pecs/sensor/source.h"

namespace pecs::input {

// Frames that are made of those of another source.
class SourceOfFrames : public sensor::FrameSource {
 public:
  explicit SourceOfFrames(std::unique_ptr<sensor::FrameSource> frames) : source_(std::move(frames)) {}
  const sensor::StackInfo& info() const override { return source_->info(); }
  std::int64_t frames() const override { return source_->frames(); }
  std::string name() const override { return source_->name(); }
  std::string layout() const override { return source_->layout(); }
  void will_read(std::int64_t index) const override { source_->will_read(index); }
  std::string options_for(int width, int height) const override { return source_->options_for(width, height); }
  sensor::SourceReport report() const override { return source_->report(); }

 protected:
  std::unique_ptr<sensor::FrameSource> source_;
};

// Mean of the bands, relative to the frame's own white (that 99.5 % of the pixels do not exceed): fading light does not
// move. The rows are also given to `sink`, if there is one.
cv::Mat_<float> relative_light(const sensor::FrameSource& frames, std::int64_t frame, const sensor::RowSink* sink);

cv::Mat grey_of(const cv::Mat_<float>& light);  // 8 bits, of gamma 2

}  // namespace pecs::input
