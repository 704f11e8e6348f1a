#include "pecs/input/display.h"

#include <OpenColorIO/OpenColorIO.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "pecs/error.h"

namespace pecs::input {
namespace {

namespace OCIO = OCIO_NAMESPACE;

constexpr const char* kXyzRole = "cie_xyz_d65_interchange";

void encode_srgb(std::span<float> rgb) {
  for (float& v : rgb) {
    const double x = std::clamp<double>(v, 0, 1);
    v = static_cast<float>(x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055);
  }
}

// The name, or the default if empty; throws if the config lacks it, and lists all names.
std::string chosen(const std::optional<std::string>& name, const char* fallback, const std::vector<std::string>& all,
                   const char* option) {
  if (!name) return fallback;
  if (std::ranges::find(all, *name) == all.end())
    throw Error(ExitCode::usage, fmt::format("{}: got '{}', wanted one of {}", option, *name, fmt::join(all, ", ")));
  return *name;
}

OCIO::ConstCPUProcessorRcPtr view_of(const OCIO::ConstConfigRcPtr& config, const DisplayOptions& options) {
  std::vector<std::string> displays, views;
  for (int i = 0; i < config->getNumDisplays(); ++i) displays.emplace_back(config->getDisplay(i));
  const std::string display = chosen(options.display, config->getDefaultDisplay(), displays, "--display");
  for (int i = 0; i < config->getNumViews(display.c_str()); ++i)
    views.emplace_back(config->getView(display.c_str(), i));
  const std::string view = chosen(options.view, config->getDefaultView(display.c_str()), views, "--view");

  const auto to_screen = OCIO::DisplayViewTransform::Create();
  to_screen->setDisplay(display.c_str());
  to_screen->setView(view.c_str());
  const auto whole = OCIO::GroupTransform::Create();
  if (config->hasRole(kXyzRole)) {
    const double xyz_from_rgb[16] = {0.4124, 0.3576, 0.1805, 0, 0.2126, 0.7152, 0.0722, 0,  // IEC 61966-2-1
                                     0.0193, 0.1192, 0.9505, 0, 0,      0,      0,      1};
    const auto matrix = OCIO::MatrixTransform::Create();
    matrix->setMatrix(xyz_from_rgb);
    whole->appendTransform(matrix);
    to_screen->setSrc(kXyzRole);
  } else {
    to_screen->setSrc(OCIO::ROLE_SCENE_LINEAR);
  }
  whole->appendTransform(to_screen);
  return config->getProcessor(whole)->getDefaultCPUProcessor();
}

}  // namespace

std::function<void(std::span<float>)> display_encoder(const DisplayOptions& options) {
  if (!options.ocio_config && !options.display && !options.view) return encode_srgb;
  try {
    const auto config = options.ocio_config ? OCIO::Config::CreateFromFile(options.ocio_config->c_str())
                                            : OCIO::Config::CreateFromEnv();
    return [processor = view_of(config, options)](std::span<float> rgb) {
      OCIO::PackedImageDesc image(rgb.data(), static_cast<long>(rgb.size() / 3), 1, 3);
      processor->apply(image);
    };
  } catch (const OCIO::Exception& e) {
    std::string words = e.what();
    std::ranges::replace(words, '\n', ' ');
    throw Error(ExitCode::usage, fmt::format("OpenColorIO: {}", words));
  }
}

}  // namespace pecs::input
