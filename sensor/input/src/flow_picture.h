#pragma once
// The picture of a frame that optical flow takes.
#include <opencv2/core.hpp>

#include "pecs/sensor/source.h"

namespace pecs::input {

// Mean of the bands, relative to the frame's own white (that 99.5 % of the pixels do not exceed): fading light does not
// move. The rows are also given to `sink`, if there is one.
cv::Mat_<float> relative_light(const sensor::FrameSource& frames, std::int64_t frame, const sensor::RowSink* sink);

cv::Mat grey_of(const cv::Mat_<float>& light);  // 8 bits, of gamma 2

}  // namespace pecs::input
