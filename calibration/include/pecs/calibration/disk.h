#pragma once
// A turning disk of alternating black and white sectors, found in its events without hints.
//
// Angles are in degrees, counter-clockwise on screen from the right (+x), seen from the disk's centre; pixel (0, 0) has
// its centre at (0.5, 0.5). In the turning frame the events of one polarity lie behind their edge; they start there, or
// (slow pixels) end where the next edge arrives: one of the two is sharp, and is what is measured.
#include <cstdint>
#include <functional>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "pecs/strict_json.h"
#include "pecs/view/event_pictures.h"

namespace pecs::calibration {

struct Measured {
  double value = 0, deviation = 0;  // standard deviation, from fits to random eighths of the events
};

struct Disk {
  Measured centre_x, centre_y;         // of the rotation, pixels
  Measured speed_deg_s;                // positive: counter-clockwise on screen
  int sectors = 0;                     // black and white ones in all
  std::int64_t phase_time_us = 0;      // time of the phases, in the file's clock: the middle of the recording
  Measured on_edge_deg, off_edge_deg;  // a brightening and a darkening edge then, modulo 720 / sectors
  bool on_starts_sharply = false, off_starts_sharply = false;  // else they end sharply: the pixels are slow
  cv::RotatedRect rim;     // ellipse of the outer edge; size 0 when it was not found
  double rim_rms_px = 0;   // of the rim's points about the ellipse
  double coherence = 0;    // |mean of polarity · exp(i m phase)|: 1 perfect, 0 none
  std::size_t events = 0;  // used
  std::vector<std::string> warnings;
};

// Where an event lies on the disk's plane, as a camera square to it would see it [px]; by default the picture is that.
using PlaceOnPlane = std::function<cv::Point2d(const cv::Point2d& pixel)>;

// Throws bad_input ("nothing found", with the reason and the best candidate) when no disk stands out.
Disk find_disk(const events::Recording& recording, const std::string& file, const PlaceOnPlane& place = {});

Json to_json(const Disk& disk);

// The events about `phase_time_us`, the rim, the centre and the edges.
cv::Mat disk_picture(const events::Recording& recording, const Disk& disk, const view::Theme& theme);

}  // namespace pecs::calibration
