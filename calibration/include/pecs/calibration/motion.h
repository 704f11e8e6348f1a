#pragma once
// Sharp pictures from the events of a moving scene: its motion over the image by contrast maximisation, and the log
// intensity that such events come from.
//
// An edge that moves by u [px/s] makes -(u · grad L) / threshold events per pixel and second, ON counted +1 and OFF -1
// (brightness constancy), so the events, carried along their motion to one instant, are a directional derivative of L.
#include <array>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <string>

#include "pecs/events/event.h"

namespace pecs::calibration {

// Velocity of the image, that of a homography to first order in time: with n = (p - centre) / scale,
//   u = scale · (a0 + a1 nx + a2 ny + nx (a6 nx + a7 ny),  a3 + a4 nx + a5 ny + ny (a6 nx + a7 ny))   [px/s]
struct Flow {
  cv::Point2d centre;
  double scale = 1;            // px
  std::array<double, 8> a{};   // 1/s
  std::string kind = "still";  // the simplest that explains the events: "translation", "similarity" or "homography"
  cv::Point2d at(double x, double y) const;
};

// Events of the window [begin_us, end_us), seen at its middle.
struct MovingView {
  std::span<const events::Event> events;
  double t_us = 0;
  Flow flow;
  double travel_px = 0;      // in the window, mean over its events
  double contrast_gain = 1;  // sum of squares of the picture of polarities, against that without motion
};

// The motion about `t_us`: `events` (in time order) are looked at in windows about it, the shortest in which things
// move by some pixels. Empty, with `why` said, when nothing moves together.
std::optional<MovingView> moving_view(std::span<const events::Event> events, cv::Size size, double t_us,
                                      std::string& why);

// Polarities (CV_32F) carried to the view's instant; of all its events, or of the even or odd ones (part 0, 1).
cv::Mat compensated(const MovingView& view, cv::Size size, int part = -1);

// The log intensity, up to scale and to slow changes over the picture (CV_32F): the least-squares solution of
// u · grad L = -polarities / time, with a little smoothness where no event tells (a motion along an edge makes none).
cv::Mat intensity(const MovingView& view, const cv::Mat& polarities);

}  // namespace pecs::calibration
