#pragma once
// Sharp pictures from the events of a moving scene: optical flow by contrast maximisation, and the log intensity that
// explains the events.
//
// An edge with the velocity u [px/s] generates -(u · grad L) / threshold events per pixel and second, ON counted +1 and
// OFF -1 (brightness constancy). So the image of warped events is a directional derivative of L.
#include <array>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <string>

#include "pecs/events/event.h"

namespace pecs::calibration {

// Image velocity of a homography, to first order in time: with n = (p - centre) / scale,
//   u = scale · (a0 + a1 nx + a2 ny + nx (a6 nx + a7 ny),  a3 + a4 nx + a5 ny + ny (a6 nx + a7 ny))   [px/s]
struct Flow {
  cv::Point2d centre;
  double scale = 1;            // px
  std::array<double, 8> a{};   // 1/s
  std::string kind = "still";  // the simplest that explains the events: "translation", "similarity" or "homography"
  cv::Point2d at(double x, double y) const;
};

// The events of a window and their flow; warped to the middle of the window.
struct FlowWindow {
  std::span<const events::Event> events;
  double t_us = 0;
  Flow flow;
  double travel_px = 0;      // over the window, mean of its events
  double contrast_gain = 1;  // sum of squares of the image of warped events, relative to that without flow
};

// Estimates the flow about `t_us` in the shortest window with a motion of some pixels; `events` are in time order.
// Empty, with the reason in `why`, without a common motion.
std::optional<FlowWindow> estimate_flow(std::span<const events::Event> events, cv::Size size, double t_us,
                                        std::string& why);

// Image of warped events (CV_32F): polarities of all events, or of the even or odd ones (part 0, 1).
cv::Mat image_of_warped_events(const FlowWindow& view, cv::Size size, int part = -1);

// Log intensity, up to scale and slow changes over the picture (CV_32F): the least-squares solution of
// u · grad L = -polarities / time, with a smoothness term (motion along an edge generates no events).
cv::Mat log_intensity(const FlowWindow& view, const cv::Mat& polarities);

}  // namespace pecs::calibration
