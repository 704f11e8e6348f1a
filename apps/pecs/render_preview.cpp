// pecs render-preview STACK -o FILE: a rendered stack in the colours of human vision, or one band in false colour.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <span>

#include "commands.h"
#include "console.h"
#include "help.h"
#include "pecs/error.h"
#include "pecs/input/display.h"
#include "pecs/input/video_file.h"
#include "pecs/progress.h"
#include "pecs/sensor/light_sampler.h"
#include "pecs/sensor/named_spectrum.h"
#include "pecs/sensor/photocurrent.h"
#include "pecs/sensor/stack.h"
#include "pecs/view/band_colours.h"
#include "picture_file.h"
#include "units.h"

namespace pecs::app {
namespace {

struct PreviewArguments {
  std::string stack, output, illuminant;
  std::int64_t frame = 0;
  double exposure_ev = 0, fps = 30;
  std::optional<double> band_nm, every_us;
  input::DisplayOptions display;
  bool json = false;
};

using Triple = std::array<double, 3>;

// The illuminant of the options, of the scene in stack.json, or d65.
std::string illuminant_of(const PreviewArguments& a) {
  if (!a.illuminant.empty()) return a.illuminant;
  const auto file = std::filesystem::path(a.stack) / "stack.json";
  if (!std::filesystem::exists(file)) return "d65";
  const Json scene = parse_json_file(file, std::size_t{64} << 20).value("scene", Json::object());
  for (const char* place : {"/illuminant", "/parameters/lamp_spectrum"})
    if (const Json::json_pointer key(place); scene.contains(key) && scene[key].is_string()) return scene[key];
  return "d65";
}

// All rows of a frame, subpixels averaged: [bands][height][width].
std::vector<float> pixels_of(const sensor::StackReader& stack, std::int64_t index) {
  const sensor::StackInfo& info = stack.info();
  return sensor::whole_frame(info.bands.size(), info.width, info.height,
                             [&](const sensor::RowSink& sink) { stack.read_rows(index, sink); });
}

// The bands' values in linear light: three planes (colour) or one (a band).
cv::Mat linear_picture(const sensor::StackInfo& info, std::vector<float> values, const std::vector<Triple>& rgb,
                       std::optional<std::size_t> band) {
  const std::size_t pixels = static_cast<std::size_t>(info.width) * info.height;
  if (band) return cv::Mat(info.height, info.width, CV_32F, &values[*band * pixels]).clone();
  cv::Mat picture(info.height, info.width, CV_32FC3, cv::Scalar::all(0));
  auto* out = picture.ptr<cv::Vec3f>();
  for (std::size_t k = 0; k < rgb.size(); ++k)
    for (std::size_t i = 0; i < pixels; ++i)
      for (int c = 0; c < 3; ++c) out[i][2 - c] += static_cast<float>(rgb[k][c]) * values[k * pixels + i];  // BGR
  return picture;
}

// Times from the first frame at which a video shows the light: each `every_us`; without, kKeyframeTimes in all, where
// motion is known between the frames. Empty: the frames.
std::vector<double> times_us_of(const sensor::StackReader& stack, std::optional<double> every_us) {
  constexpr double kKeyframeTimes = 100, kMost = 1e6;
  const sensor::StackInfo& info = stack.info();
  const std::int64_t length_ns =
      info.period_ns.value_or(info.times_ns[static_cast<std::size_t>(stack.frames()) - 1] - info.times_ns[0]);
  const double length_us = 1e-3 * static_cast<double>(length_ns);
  if (!every_us && stack.has_motion() && length_ns > 0) every_us = length_us / (kKeyframeTimes - 1);
  if (!every_us) return {};
  const double number = std::floor(length_us / *every_us * (1 + 1e-9)) + 1;
  if (number > kMost)
    throw Error(ExitCode::usage, fmt::format("--every: got {} us, which are {:.0f} pictures, wanted at most {:.0f}",
                                             *every_us, number, kMost));
  std::vector<double> times_us;
  for (double i = 0; i < number; ++i) times_us.push_back(std::min(i * *every_us, length_us));
  return times_us;
}

// The light of each band between the frames, as pixels see it.
std::unique_ptr<sensor::LightSampler> sampler_of(const sensor::StackReader& stack) {
  const std::size_t bands = stack.info().bands.size();
  std::vector<sensor::Response> each;
  for (std::size_t k = 0; k < bands; ++k) {
    std::vector<double> one(bands, 0.0);
    one[k] = 1;
    each.emplace_back(std::move(one));
  }
  return std::make_unique<sensor::LightSampler>(stack, each);
}

// The 99th percentile of the brightest channel, so that a visible lamp does not darken the rest.
double white_level(const cv::Mat& picture) {
  std::vector<float> top;
  const int channels = picture.channels();
  const float* v = picture.ptr<float>();
  for (std::size_t i = 0; i < picture.total(); ++i)
    top.push_back(*std::max_element(v + i * channels, v + (i + 1) * channels));
  return std::max<double>(sensor::quantile(std::move(top), 0.99), 1e-30);
}

using Encoder = std::function<void(std::span<float>)>;

// 8 bits a channel; a single band in false colour.
cv::Mat to_display(const cv::Mat& linear, double scale, const Encoder& encode) {
  cv::Mat values;
  linear.convertTo(values, CV_32F, scale);
  if (values.channels() == 3) cv::cvtColor(values, values, cv::COLOR_BGR2RGB);
  encode({values.ptr<float>(), values.total() * values.channels()});
  cv::Mat picture;
  values.convertTo(picture, CV_8U, 255);
  if (picture.channels() == 3)
    cv::cvtColor(picture, picture, cv::COLOR_RGB2BGR);
  else
    cv::applyColorMap(picture, picture, cv::COLORMAP_VIRIDIS);
  return picture;
}

void run(const PreviewArguments& a, Console& console) {
  const std::filesystem::path output = a.output;
  const std::string extension = output.extension().string();
  if (extension != ".png" && extension != ".mp4")
    throw Error(ExitCode::usage, fmt::format("-o: got '{}', wanted a name that ends in .png or .mp4", a.output));
  if (extension == ".png" && a.every_us) throw Error(ExitCode::usage, "--every: is for videos, got a .png");
  const sensor::StackReader stack(a.stack);
  const std::vector<sensor::Band>& bands = stack.info().bands;
  if (stack.frames() == 0) throw bad_input(a.stack, "frames", "none", "at least one");
  const std::int64_t first = extension == ".png" ? a.frame : 0;
  if (first >= stack.frames())
    throw Error(ExitCode::usage, fmt::format("--frame: got {}, wanted one of 0..{}", first, stack.frames() - 1));

  std::optional<std::size_t> band;
  if (a.band_nm) {
    const auto distance = [&](const sensor::Band& b) { return std::abs(b.lambda_nm - *a.band_nm); };
    const auto nearest = std::min_element(bands.begin(), bands.end(),
                                          [&](const auto& x, const auto& y) { return distance(x) < distance(y); });
    band = static_cast<std::size_t>(nearest - bands.begin());
  }
  const Encoder encode = input::display_encoder(a.display);
  const std::string illuminant = illuminant_of(a);
  const std::vector<Triple> rgb = view::rgb_of_bands(bands, sensor::named_spectrum(illuminant));
  const cv::Mat picture = linear_picture(stack.info(), pixels_of(stack, first), rgb, band);
  const double scale = std::exp2(a.exposure_ev) / white_level(picture);

  Json result = {{"output", a.output}, {"scale", scale}};
  if (band) result["band_nm"] = bands[*band].lambda_nm;
  if (extension == ".png") {
    result["frames"] = 1;
    write_png(a.output, to_display(picture, scale, encode));
  } else {
    const std::vector<double> times_us = times_us_of(stack, a.every_us);
    const auto pictures = times_us.empty() ? stack.frames() : static_cast<std::int64_t>(times_us.size());
    const auto light = times_us.empty() ? nullptr : sampler_of(stack);
    input::VideoFile video(output, a.fps);
    Progress progress("render-preview", static_cast<std::uint64_t>(pictures), a.json || console.quiet());
    for (std::int64_t i = 0; i < pictures; ++i) {
      std::vector<float> values(light ? light->values() : 0);
      if (light)
        light->at({&times_us[i], 1}, values);
      else
        values = pixels_of(stack, i);
      video.write(to_display(linear_picture(stack.info(), std::move(values), rgb, band), scale, encode));
      progress.at(static_cast<std::uint64_t>(i + 1));
    }
    video.close();
    result["frames"] = pictures;
    if (light) result["every_us"] = times_us.size() > 1 ? times_us[1] : 0;
  }
  const Json config = {{"frame", first},
                       {"exposure_ev", a.exposure_ev},
                       {"fps", a.fps},
                       {"every_us", or_null(a.every_us)},
                       {"illuminant", illuminant},
                       {"band_nm", or_null(a.band_nm)},
                       {"ocio", a.display.ocio_config ? Json(a.display.ocio_config->string()) : Json(nullptr)},
                       {"display", or_null(a.display.display)},
                       {"view", or_null(a.display.view)}};
  console.record(output, {.command = "render-preview", .config = config, .inputs = {a.stack}, .results = result});
  if (a.json) return print_json(result, 2);
  fmt::print("{}: {} frame{}\n", a.output, result["frames"].get<std::int64_t>(), result["frames"] == 1 ? "" : "s");
}

}  // namespace

void add_render_preview(CLI::App& app, Console& console) {
  auto a = std::make_shared<PreviewArguments>();
  auto* command = app.add_subcommand("render-preview", "convert a rendered stack to a picture (.png) or video (.mp4)");
  command->add_option("STACK", a->stack, "EXR stack with stack.json")->required();
  add_output(*command, "-o,--output", a->output, "file to write: .png or .mp4")->required();
  command->add_option("--frame", a->frame, "png: frame to show")
      ->check(CLI::Range(0, 100'000'000))
      ->capture_default_str();
  add_quantity(*command, "--exposure", a->exposure_ev, "EV",
               "exposure, relative to one that saturates 1 % of the first frame")
      ->check(CLI::Range(-30.0, 30.0))
      ->capture_default_str();
  command->add_option(
      "--illuminant", a->illuminant,
      "illuminant of the white point: a name from lens_data/spectra, a CSV file, blackbody:T or daylight:T "
      "(default: that of the scene in stack.json, or d65)");
  auto* view =
      command->add_option("--view", a->display.view, "view transform of an OpenColorIO config (default: sRGB)");
  auto* display =
      command->add_option("--display", a->display.display, "display of that config (default: that of the config)");
  auto* ocio = command->add_option("--ocio", a->display.ocio_config, "OpenColorIO config (default: $OCIO)");
  add_quantity(*command, "--band", a->band_nm, "nm", "show only the nearest band, in false colour (default: colour)")
      ->check(CLI::Range(100.0, 10000.0))
      ->excludes(view)
      ->excludes(display)
      ->excludes(ocio);
  add_quantity(*command, "--fps", a->fps, "Hz", "mp4: frames per second")
      ->check(CLI::Range(1.0, 240.0))
      ->capture_default_str();
  add_quantity(*command, "--every", a->every_us, "us",
               "mp4: time between pictures; between frames, light follows the motion (default: all frames of "
               "uniform steps, 100 times over keyframes)")
      ->check(positive());
  command->add_flag("--json", a->json, "machine-readable output");
  add_examples(*command, {"pecs render-preview out/stack -o first.png --exposure 1EV",
                          "pecs render-preview out/stack -o stack.mp4 --every 1ms --fps 24",
                          "pecs render-preview out/stack -o blue.png --band 450nm"});
  command->callback([a, &console] { run(*a, console); });
}

}  // namespace pecs::app
