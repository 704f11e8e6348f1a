#pragma once
// Encoded pixels to scene-linear light.
#include <OpenColorIO/OpenColorIO.h>

#include <opencv2/core.hpp>

#include "pecs/input/pictures.h"

namespace pecs::input {

class Linear {
 public:
  explicit Linear(const PictureOptions& options);  // throws usage
  std::vector<sensor::Band> bands_of(const cv::Mat& picture) const;
  std::vector<float> operator()(cv::Mat picture) const;  // [band][row][x]; bands blue, green, red, or grey

 private:
  std::optional<std::string> space_;
  float gamma_ = 0;  // of "gamma:G"
  OCIO_NAMESPACE::ConstCPUProcessorRcPtr processor_;
};

}  // namespace pecs::input
