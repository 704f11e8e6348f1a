#include "flow_picture.h"

#include <algorithm>
#include <cmath>

#include "pecs/sensor/photocurrent.h"

namespace pecs::input {

cv::Mat_<float> relative_light(const sensor::FrameSource& frames, std::int64_t frame, const sensor::RowSink* sink) {
  cv::Mat_<float> light(frames.info().height, frames.info().width, 0.0f);
  frames.read_rows(frame, [&](int y, int rows, std::span<const float> values) {
    if (sink) (*sink)(y, rows, values);
    const std::size_t plane = static_cast<std::size_t>(rows) * static_cast<std::size_t>(light.cols);
    const std::size_t planes = values.size() / plane;
    const auto bands = static_cast<float>(planes);
    float* to = light[y];
    for (std::size_t i = 0; i < values.size(); ++i)
      if (std::isfinite(values[i])) to[i % plane] += std::max(0.0f, values[i]) / bands;
  });
  light /= std::max(sensor::quantile({light.begin(), light.end()}, 0.995), 1e-20f);
  return light;
}

cv::Mat grey_of(const cv::Mat_<float>& light) {
  cv::Mat grey;
  cv::sqrt(cv::min(light, 1), grey);
  grey.convertTo(grey, CV_8U, 255);
  return grey;
}

}  // namespace pecs::input
