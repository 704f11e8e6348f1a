#include "pecs/view/event_pictures.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "pecs/input/video_file.h"

namespace pecs::view {
namespace {

using events::Event;

cv::Scalar bgr(const events::Rgb& c) { return {double(c.b), double(c.g), double(c.r)}; }

std::span<const Event> between(const events::Recording& recording, std::int64_t from_us, std::int64_t to_us) {
  return events::between(recording.events, static_cast<double>(from_us), static_cast<double>(to_us));
}

std::string with_unit(std::int64_t t_us, std::int64_t scale_us) {
  if (scale_us >= 2'000'000) return fmt::format("{:.3f} s", static_cast<double>(t_us) * 1e-6);
  if (scale_us >= 2'000) return fmt::format("{:.2f} ms", static_cast<double>(t_us) * 1e-3);
  return fmt::format("{} us", t_us);
}

// Draws text with its top left corner at `at`; returns its width.
int put_text(cv::Mat& image, const std::string& text, cv::Point at, double size, const cv::Scalar& colour) {
  int below = 0;
  const cv::Size box = cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, size, 1, &below);
  cv::putText(image, text, {at.x, at.y + box.height}, cv::FONT_HERSHEY_SIMPLEX, size, colour, 1, cv::LINE_AA);
  return box.width;
}

// Draws "[] ON  [] OFF" at the right border.
void put_legend(cv::Mat& image, int y, const Theme& theme) {
  int x = image.cols - 150;
  for (const auto& [name, colour] : {std::pair{"ON", theme.on}, {"OFF", theme.off}}) {
    cv::rectangle(image, {x, y, 12, 12}, bgr(colour), cv::FILLED);
    x += 20 + put_text(image, name, {x + 18, y}, 0.45, bgr(theme.ink)) + 18;
  }
}

// An event frame about `width` pixels wide, in square dots of at least `dot` pixels.
cv::Mat panel_of(const events::Recording& recording, std::int64_t from_us, std::int64_t to_us, const Theme& theme,
                 int width, int dot) {
  const int binning = std::max(1, recording.width * dot / width);
  const cv::Mat cells = event_frame(recording, from_us, to_us, theme, binning);
  const int times = std::max(dot, width / cells.cols);
  cv::Mat panel;
  cv::resize(cells, panel, {cells.cols * times, cells.rows * times}, 0, 0, cv::INTER_NEAREST);
  return panel;
}

}  // namespace

cv::Mat event_frame(const events::Recording& recording, std::int64_t from_us, std::int64_t to_us, const Theme& theme,
                    int binning) {
  auto cells = events::picture(between(recording, from_us, to_us), recording.width, recording.height, theme, binning);
  const int width = (recording.width + binning - 1) / binning;
  cv::Mat frame;
  cv::cvtColor(cv::Mat(static_cast<int>(cells.size()) / width, width, CV_8UC3, cells.data()), frame, cv::COLOR_RGB2BGR);
  return frame;
}

std::int64_t readable_window_us(const events::Recording& recording, std::int64_t limit_us) {
  const double wanted = 0.05 * recording.width * recording.height;
  const double window = wanted / static_cast<double>(recording.events.size()) * static_cast<double>(recording.span_us);
  return std::max<std::int64_t>(1, std::min<std::int64_t>(limit_us, std::llround(window)));
}

cv::Mat contact_sheet(const events::Recording& recording, std::int64_t window_us, int count, const Theme& theme) {
  constexpr int kGap = 12, kHead = 40, kCaption = 22;
  const int columns = count <= 1 ? 1 : count <= 4 ? 2 : 3, rows = (count + columns - 1) / columns;

  cv::Mat sheet;
  for (int i = 0; i < count; ++i) {
    const std::int64_t room = std::max<std::int64_t>(0, recording.span_us - window_us);
    const std::int64_t from = count > 1 ? room * i / (count - 1) : 0, to = from + window_us;
    const cv::Mat panel = panel_of(recording, from, to, theme, 640, 1);
    if (sheet.empty())
      sheet.create(kHead + rows * (panel.rows + kCaption + kGap), kGap + columns * (panel.cols + kGap), CV_8UC3),
          sheet.setTo(bgr(theme.paper));
    const cv::Point at(kGap + (i % columns) * (panel.cols + kGap),
                       kHead + (i / columns) * (panel.rows + kCaption + kGap));
    panel.copyTo(sheet(cv::Rect(at.x, at.y + kCaption, panel.cols, panel.rows)));
    cv::rectangle(sheet, {at.x, at.y + kCaption, panel.cols, panel.rows},
                  bgr(theme.ink) * 0.4 + bgr(theme.paper) * 0.6);
    const std::size_t shown = between(recording, from, to).size();
    const auto time = [&](std::int64_t t_us) { return with_unit(recording.from_us + t_us, recording.span_us); };
    put_text(sheet, fmt::format("{} .. {}  {} event{}", time(from), time(to), shown, shown == 1 ? "" : "s"),
             {at.x, at.y + 5}, 0.45, bgr(theme.ink));
  }
  put_text(sheet,
           fmt::format("{}  {}x{}  {} events in {}", recording.name, recording.width, recording.height,
                       recording.events.size(), with_unit(recording.span_us, recording.span_us)),
           {kGap, 14}, 0.5, bgr(theme.ink));
  put_legend(sheet, 14, theme);
  return sheet;
}

VideoInfo write_video(const events::Recording& recording, const std::filesystem::path& path,
                      const VideoOptions& options) {
  constexpr int kHead = 26, kWidth = 1280,
                kDot = 2;  // dots of 2 pixels keep their colour under 4:2:0 chroma subsampling
  const double step_us = 1e6 / (options.fps * options.slow_motion);
  const std::int64_t window_us =
      options.window_us > 0
          ? options.window_us
          : std::max<std::int64_t>(readable_window_us(recording, recording.span_us), std::llround(step_us));

  input::VideoFile video(path, options.fps);
  const auto frames = static_cast<int>(std::ceil(static_cast<double>(recording.span_us) / step_us));
  cv::Mat canvas;
  for (int frame = 0; frame < frames; ++frame) {
    const std::int64_t to = std::llround((frame + 1) * step_us), from = to - window_us;
    const cv::Mat panel = panel_of(recording, from, to, options.theme, kWidth, kDot);
    canvas.create(panel.rows + kHead, panel.cols, CV_8UC3);
    canvas.setTo(bgr(options.theme.paper));
    panel.copyTo(canvas(cv::Rect(0, kHead, panel.cols, panel.rows)));
    put_text(canvas,
             fmt::format("t = {}   last {}   {:g}x slower", with_unit(recording.from_us + to, recording.span_us),
                         with_unit(window_us, recording.span_us), options.slow_motion),
             {8, 8}, 0.45, bgr(options.theme.ink));
    put_legend(canvas, 7, options.theme);
    video.write(canvas);
  }
  video.close();
  return {frames, video.codec()};
}

}  // namespace pecs::view
