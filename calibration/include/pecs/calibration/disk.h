#pragma once
// Detects a rotating disk of alternating black and white sectors in its events, without prior knowledge.
//
// Angles are in degrees, counter-clockwise on screen from the right (+x), seen from the disk's centre; pixel (0, 0) has
// its centre at (0.5, 0.5). In the rotating frame the events of one polarity follow their edge: they start sharply at
// it, or (slow pixels) end sharply where the next edge arrives. The sharp one is measured.
#include <cstdint>
#include <functional>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "pecs/strict_json.h"
#include "pecs/view/event_pictures.h"

namespace pecs::calibration {

struct Measured {
  double value = 0, deviation = 0;  // standard deviation, from fits to random eighths of the pixels
};

struct DetectedDisk {
  Measured centre_x, centre_y;         // of the rotation, pixels
  Measured speed_deg_s;                // positive: counter-clockwise on screen
  int sectors = 0;                     // black and white together
  std::int64_t phase_time_us = 0;      // time of the edge angles, clock of the file: the middle of the recording
  Measured on_edge_deg, off_edge_deg;  // a brightening and a darkening edge at that time, modulo 720 / sectors
  bool on_starts_sharply = false, off_starts_sharply = false;  // otherwise they end sharply: the pixels are slow
  cv::RotatedRect rim;                                         // ellipse of the outer edge; size 0 when not found
  double rim_rms_px = 0;                                       // of the rim's points about the ellipse
  double coherence = 0;                                        // |mean of polarity · exp(i m phase)|, in [0, 1]
  std::size_t events = 0;                                      // used
  std::vector<std::string> warnings;
};

// Maps a pixel to the disk's plane as seen by a camera perpendicular to it [px]; default: the identity.
using PlaneFromPixel = std::function<cv::Point2d(const cv::Point2d& pixel)>;

// Throws bad_input ("nothing found", with the reason and the best candidate) without a significant disk.
DetectedDisk find_disk(const events::Recording& recording, const std::string& file,
                       const PlaneFromPixel& plane_from_pixel = {});

Json to_json(const DetectedDisk& disk);

// The events about `phase_time_us`, the rim, the centre and the edges.
cv::Mat disk_picture(const events::Recording& recording, const DetectedDisk& disk, const view::Theme& theme);

}  // namespace pecs::calibration
