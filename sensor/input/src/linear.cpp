#include "linear.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "pecs/error.h"
#include "pecs/text.h"

namespace pecs::input {
namespace {

namespace OCIO = OCIO_NAMESPACE;

// IEC 61966-2-1.
float from_srgb(float v) { return v <= 0.04045f ? v / 12.92f : std::pow((std::max(v, 0.0f) + 0.055f) / 1.055f, 2.4f); }

}  // namespace

Linear::Linear(const PictureOptions& options) : space_(options.colour_space) {
  constexpr std::string_view kGamma = "gamma:";
  if (space_ && space_->starts_with(kGamma)) {
    gamma_ = number_from<float>(std::string_view(*space_).substr(kGamma.size())).value_or(0);
    if (!(gamma_ >= 0.1f && gamma_ <= 10))
      throw Error(ExitCode::usage, fmt::format("--colorspace: got {}, wanted gamma:G with G from 0.1 to 10", *space_));
  }
  if (!space_ || *space_ == "srgb" || *space_ == "linear" || gamma_ > 0) {
    if (options.ocio_config && !space_)
      throw Error(ExitCode::usage, "--colorspace: got nothing, wanted a colour space of the config");
    if (!options.ocio_config) return;
  }
  try {
    const auto config = options.ocio_config ? OCIO::Config::CreateFromFile(options.ocio_config->c_str())
                                            : OCIO::Config::CreateFromEnv();
    processor_ = config->getProcessor(space_->c_str(), OCIO::ROLE_SCENE_LINEAR)->getDefaultCPUProcessor();
  } catch (const OCIO::Exception& e) {
    std::string words = e.what();
    std::ranges::replace(words, '\n', ' ');
    throw Error(ExitCode::usage, fmt::format("--colorspace {}: {}", *space_, words));
  }
}

std::vector<sensor::Band> Linear::bands_of(const cv::Mat& picture) const {
  if (picture.channels() == 1 && !processor_) return {{550, 1}};
  return {{465, 1}, {550, 1}, {610, 1}};
}

std::vector<float> Linear::operator()(cv::Mat picture) const {
  if (picture.channels() == 4) cv::cvtColor(picture, picture, cv::COLOR_BGRA2BGR);
  const bool integer = picture.depth() == CV_8U || picture.depth() == CV_16U;
  cv::Mat values;
  picture.convertTo(values, CV_32F, picture.depth() == CV_8U ? 1 / 255.0 : integer ? 1 / 65535.0 : 1.0);
  if (processor_) {
    cv::cvtColor(values, values, values.channels() == 1 ? cv::COLOR_GRAY2RGB : cv::COLOR_BGR2RGB);
    OCIO::PackedImageDesc image(values.data, values.cols, values.rows, 3);
    processor_->apply(image);
    cv::cvtColor(values, values, cv::COLOR_RGB2BGR);
  } else if (gamma_ > 0 || (space_ ? *space_ == "srgb" : integer)) {
    const int n = values.cols * values.channels();
    for (int y = 0; y < values.rows; ++y) {
      auto* row = values.ptr<float>(y);
      for (int i = 0; i < n; ++i) row[i] = gamma_ > 0 ? std::pow(std::max(row[i], 0.0f), gamma_) : from_srgb(row[i]);
    }
  }
  std::vector<cv::Mat> channels;
  cv::split(values, channels);
  std::vector<float> out;
  out.reserve(values.total() * channels.size());
  for (const cv::Mat& c : channels) out.insert(out.end(), c.begin<float>(), c.end<float>());
  return out;
}

}  // namespace pecs::input
