#pragma once
// Events made visible: frames, contact sheets, slow-motion video, and a page to turn in three dimensions. ON is blue
// and OFF is orange, which colour-blind people can tell apart (Okabe and Ito, 2008); blank pixels saw no event.
#include <cstdint>
#include <filesystem>
#include <map>
#include <opencv2/core.hpp>
#include <span>
#include <string>

#include "pecs/events/recording.h"

namespace pecs::view {

struct Rgb {
  std::uint8_t r, g, b;
  std::string hex() const;  // "#0072b2"
};

struct Theme {
  Rgb paper, ink, on, off;
};
inline constexpr Theme kLight{{255, 255, 255}, {27, 31, 36}, {0, 114, 178}, {213, 94, 0}};
inline constexpr Theme kDark{{20, 23, 27}, {232, 235, 238}, {86, 180, 233}, {240, 140, 40}};

// Events of [from_us, to_us): the hue mixes a cell's polarities, the strength grows with their number. A cell is
// `binning` x `binning` pixels. CV_8UC3, BGR, one image pixel per cell.
cv::Mat event_frame(const events::Recording& recording, std::int64_t from_us, std::int64_t to_us, const Theme& theme,
                    int binning = 1);

// The window that puts an event on about one pixel in twenty, at most `limit_us`: busy enough to see, not blurred.
std::int64_t readable_window_us(const events::Recording& recording, std::int64_t limit_us);

// `count` windows spread evenly over the recording, under a line that says what is shown.
cv::Mat contact_sheet(const events::Recording& recording, std::int64_t window_us, int count, const Theme& theme);

struct VideoOptions {
  double fps = 30;
  double slow_motion = 100;    // video seconds per second of the recording
  std::int64_t window_us = 0;  // events shown in one frame; 0: readable_window_us, but never a gap
  Theme theme = kLight;
};
struct VideoInfo {
  int frames = 0;
  std::string codec;
};
// H.264 in MP4 where OpenCV has an encoder, else MPEG-4. The file appears whole or not at all. Throws bad_output.
VideoInfo write_video(const events::Recording& recording, const std::filesystem::path& path,
                      const VideoOptions& options);

// One HTML file that needs nothing else. Above `limit` events it shows that many, drawn at random, and says so.
// Returns how many it shows.
std::size_t write_page(const events::Recording& recording, const std::filesystem::path& path, std::size_t limit);

// Replaces every {{key}} of a template. Throws internal for a key without a value.
std::string fill_template(std::string_view text, const std::map<std::string, std::string>& values);
std::string base64(std::span<const std::uint8_t> bytes);
std::string html_escaped(std::string_view text);

}  // namespace pecs::view
