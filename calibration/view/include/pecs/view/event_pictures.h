#pragma once
// Visualisation of events: frames, contact sheets, slow-motion video, and an interactive 3-D page.
#include <cstdint>
#include <filesystem>
#include <opencv2/core.hpp>
#include <span>
#include <string>

#include "pecs/events/picture.h"
#include "pecs/events/recording.h"

namespace pecs::view {

using events::kDark, events::kLight, events::Theme;

// events::picture of those in [from_us, to_us): CV_8UC3, BGR, one image pixel per cell.
cv::Mat event_frame(const events::Recording& recording, std::int64_t from_us, std::int64_t to_us, const Theme& theme,
                    int binning = 1);

// The window with one event per twenty pixels, at most `limit_us`: dense enough to see shapes, without motion blur.
std::int64_t readable_window_us(const events::Recording& recording, std::int64_t limit_us);

// `count` windows spread evenly over the recording, below a caption.
cv::Mat contact_sheet(const events::Recording& recording, std::int64_t window_us, int count, const Theme& theme);

struct VideoOptions {
  double fps = 30;
  double slow_motion = 100;    // video seconds per second of the recording
  std::int64_t window_us = 0;  // events shown in one frame; 0: readable_window_us, at least the frame interval
  Theme theme = kLight;
};
struct VideoInfo {
  int frames = 0;
  std::string codec;
};
// H.264 in MP4 if OpenCV has an encoder, otherwise MPEG-4. Writes the complete file or none. Throws bad_output.
VideoInfo write_video(const events::Recording& recording, const std::filesystem::path& path,
                      const VideoOptions& options);

// A self-contained HTML file with at most `limit` events, drawn at random; its caption states that. Returns their
// number.
std::size_t write_page(const events::Recording& recording, const std::filesystem::path& path, std::size_t limit);

}  // namespace pecs::view
