// pecs render-preview STACK -o FILE: a rendered stack as the eye would see it, or one band in false colour.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <span>
#include <sstream>

#include "commands.h"
#include "pecs/data_dir.h"
#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/input/display.h"
#include "pecs/progress.h"
#include "pecs/run_record.h"
#include "pecs/sensor/stack.h"

namespace pecs::app {
namespace {

struct Arguments {
  std::string stack, output;
  std::int64_t frame = 0;
  double exposure_ev = 0, fps = 30;
  std::optional<double> band_nm;
  input::DisplayOptions display;
  bool json = false;
};

using Triple = std::array<double, 3>;

// Colour matching functions at lambda_nm, linear in between, zero outside.
Triple cie1931(double lambda_nm) {
  static const std::vector<std::array<double, 4>> table = [] {
    std::istringstream lines(read_text(data_dir("lens_data/spectra") / "basis" / "cie1931.csv", 1 << 20));
    std::vector<std::array<double, 4>> rows;
    for (std::string line; std::getline(lines, line);) {
      std::array<double, 4> r{};
      if (std::sscanf(line.c_str(), "%lf,%lf,%lf,%lf", &r[0], &r[1], &r[2], &r[3]) == 4) rows.push_back(r);
    }
    return rows;
  }();
  const auto above = std::lower_bound(table.begin(), table.end(), lambda_nm,
                                      [](const std::array<double, 4>& row, double nm) { return row[0] < nm; });
  if (above == table.end() || (above == table.begin() && (*above)[0] > lambda_nm)) return {};
  if (above == table.begin()) return {(*above)[1], (*above)[2], (*above)[3]};
  const auto& a = *(above - 1);
  const auto& b = *above;
  const double f = (lambda_nm - a[0]) / (b[0] - a[0]);
  return {a[1] + f * (b[1] - a[1]), a[2] + f * (b[2] - a[2]), a[3] + f * (b[3] - a[3])};
}

// Linear sRGB per unit of band: X = sum w_k x(lambda_k) S_k, then IEC 61966-2-1's matrix.
std::vector<Triple> rgb_of_bands(const std::vector<sensor::Band>& bands) {
  constexpr double kRgbFromXyz[3][3] = {
      {3.2406, -1.5372, -0.4986}, {-0.9689, 1.8758, 0.0415}, {0.0557, -0.2040, 1.0570}};
  std::vector<Triple> rgb;
  for (const sensor::Band& band : bands) {
    const Triple xyz = cie1931(band.lambda_nm);
    Triple& c = rgb.emplace_back();
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) c[i] += kRgbFromXyz[i][j] * xyz[j] * band.weight_nm;
  }
  return rgb;
}

// What is shown of a frame: three planes (colour) or one (a band), linear.
cv::Mat linear_picture(const sensor::StackReader& stack, std::int64_t index, const std::vector<Triple>& rgb,
                       std::optional<std::size_t> band) {
  const sensor::StackInfo& info = stack.info();
  const std::vector<float> values = stack.read_frame(index);
  const std::size_t pixels = static_cast<std::size_t>(info.width) * info.height;
  if (band) return cv::Mat(info.height, info.width, CV_32F, const_cast<float*>(&values[*band * pixels])).clone();
  cv::Mat picture(info.height, info.width, CV_32FC3, cv::Scalar::all(0));
  auto* out = picture.ptr<cv::Vec3f>();
  for (std::size_t k = 0; k < rgb.size(); ++k)
    for (std::size_t i = 0; i < pixels; ++i)
      for (int c = 0; c < 3; ++c) out[i][2 - c] += static_cast<float>(rgb[k][c]) * values[k * pixels + i];  // BGR
  return picture;
}

// The 99th percentile of the brightest channel: a lamp in view does not darken the rest.
double white_level(const cv::Mat& picture) {
  std::vector<float> top;
  const int channels = picture.channels();
  const float* v = picture.ptr<float>();
  for (std::size_t i = 0; i < picture.total(); ++i)
    top.push_back(*std::max_element(v + i * channels, v + (i + 1) * channels));
  const auto at = top.begin() + static_cast<std::ptrdiff_t>(0.99 * static_cast<double>(top.size() - 1));
  std::nth_element(top.begin(), at, top.end());
  return std::max<double>(*at, 1e-30);
}

using Encoder = std::function<void(std::span<float>)>;

// 8 bits a channel; a single band in false colour.
cv::Mat to_display(const cv::Mat& linear, double scale, const Encoder& encode) {
  cv::Mat values;
  linear.convertTo(values, CV_32F, scale);
  if (values.channels() == 3) cv::cvtColor(values, values, cv::COLOR_BGR2RGB);
  encode({values.ptr<float>(), values.total() * values.channels()});
  cv::Mat recording;
  values.convertTo(recording, CV_8U, 255);
  if (recording.channels() == 3)
    cv::cvtColor(recording, recording, cv::COLOR_RGB2BGR);
  else
    cv::applyColorMap(recording, recording, cv::COLORMAP_VIRIDIS);
  return recording;
}

Json text_or_null(const std::optional<std::string>& text) { return text ? Json(*text) : Json(nullptr); }

void write_png(const cv::Mat& picture, const std::filesystem::path& output) {
  std::vector<std::uint8_t> png;
  cv::imencode(".png", picture, png);
  AtomicFile file(output);
  file.write(std::as_bytes(std::span(png)));
  file.commit();
}

void run(const Arguments& a) {
  const std::filesystem::path output = a.output;
  const std::string extension = output.extension().string();
  if (extension != ".png" && extension != ".mp4")
    throw Error(ExitCode::usage, fmt::format("-o: got '{}', wanted a name that ends in .png or .mp4", a.output));
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
  const std::vector<Triple> rgb = rgb_of_bands(bands);
  cv::Mat picture = linear_picture(stack, first, rgb, band);
  const double scale = std::exp2(a.exposure_ev) / white_level(picture);

  Json result = {{"output", a.output}, {"scale", scale}};
  if (band) result["band_nm"] = bands[*band].lambda_nm;
  if (extension == ".png") {
    result["frames"] = 1;
    write_png(to_display(picture, scale, encode), output);
  } else {
    PartialFile partial(output);
    // OpenCV takes the container from the extension, so the unfinished file keeps it. H.264 wants even sizes.
    const std::filesystem::path unfinished = output.parent_path() / ("." + output.stem().string() + ".partial.mp4");
    const cv::Rect even(0, 0, picture.cols / 2 * 2, picture.rows / 2 * 2);
    cv::VideoWriter video;
    for (const char* codec : {"avc1", "mp4v"}) {
      if (video.isOpened()) break;
      video.open(unfinished.string(), cv::CAP_FFMPEG, cv::VideoWriter::fourcc(codec[0], codec[1], codec[2], codec[3]),
                 a.fps, even.size());
    }
    if (!video.isOpened()) throw bad_output(a.output, "no video encoder could be opened (disk, FFmpeg?)");
    Progress progress("render-preview", static_cast<std::uint64_t>(stack.frames()), a.json);
    for (std::int64_t i = 0; i < stack.frames(); ++i) {
      video.write(to_display(linear_picture(stack, i, rgb, band), scale, encode)(even));
      progress.at(static_cast<std::uint64_t>(i + 1));
    }
    video.release();
    partial.commit(unfinished);
    result["frames"] = stack.frames();
  }
  const Json config = {{"frame", first},
                       {"exposure_ev", a.exposure_ev},
                       {"fps", a.fps},
                       {"band_nm", a.band_nm ? Json(*a.band_nm) : Json(nullptr)},
                       {"ocio", a.display.ocio_config ? Json(a.display.ocio_config->string()) : Json(nullptr)},
                       {"display", text_or_null(a.display.display)},
                       {"view", text_or_null(a.display.view)}};
  write_run_record(output, {.command = "render-preview",
                            .arguments = arguments(),
                            .config = config,
                            .inputs = {a.stack},
                            .results = result});
  if (a.json)
    fmt::print("{}\n", result.dump(2));
  else
    fmt::print("{}: {} frame{}\n", a.output, result["frames"].get<std::int64_t>(), result["frames"] == 1 ? "" : "s");
}

}  // namespace

void add_render_preview(CLI::App& app) {
  auto a = std::make_shared<Arguments>();
  auto* command = app.add_subcommand("render-preview", "A rendered stack as a picture (.png) or video (.mp4)");
  command->add_option("STACK", a->stack, "EXR stack with stack.json")->required();
  command->add_option("-o,--output", a->output, "What to write; the ending chooses")->required();
  command->add_option("--frame", a->frame, "png: which frame")->check(CLI::NonNegativeNumber)->capture_default_str();
  command->add_option("--exposure-ev", a->exposure_ev, "Stops brighter than: 1 % of the first frame is white")
      ->check(CLI::Range(-30.0, 30.0))
      ->capture_default_str();
  auto* view =
      command->add_option("--view", a->display.view, "View transform of an OpenColorIO config (default: sRGB)");
  auto* display = command->add_option("--display", a->display.display, "Display of that config (default: its own)");
  auto* ocio = command->add_option("--ocio", a->display.ocio_config, "OpenColorIO config (default: $OCIO)");
  command
      ->add_option("--band-nm", a->band_nm, "The nearest band alone, in false colour (default: true colour, CIE 1931)")
      ->check(CLI::Range(100.0, 10000.0))
      ->excludes(view)
      ->excludes(display)
      ->excludes(ocio);
  command->add_option("--fps", a->fps, "mp4: frames per second")->check(CLI::Range(1.0, 240.0))->capture_default_str();
  command->add_flag("--json", a->json, "Machine-readable output");
  command->callback([a] { run(*a); });
}

}  // namespace pecs::app
