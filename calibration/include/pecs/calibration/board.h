#pragma once
// Calibration boards in events and in frames: checkerboards, grids of circles; moving or blinking.
//
// Points are in pixels; (0.5, 0.5) is the centre of the top left one. They are ordered row by row in the reading of the
// board that is nearest to upright (a board without marks looks the same upside down).
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "pecs/calibration/contrast_maximisation.h"
#include "pecs/strict_json.h"
#include "pecs/view/event_pictures.h"

namespace pecs::calibration {

enum class Pattern { checkerboard, circles, asymmetric_circles };
Pattern pattern_from(const std::string& name);  // "checkerboard", "circles", "asymmetric-circles"; throws usage

struct BoardShape {
  Pattern pattern = Pattern::checkerboard;
  int columns = 0, rows = 0;  // inner corners, or circles, along a row and a column (asymmetric: OpenCV's count)
  double spacing_mm = 1;      // distance of neighbours; asymmetric: of rows
  std::vector<cv::Point3d> points_mm() const;  // x right, y down, z = 0; origin at the centre of the board
  std::string text() const;                    // "checkerboard of 3 x 3 inner corners"
};

struct BoardView {
  double t_us = 0;                  // time of the points, clock of the file
  std::vector<cv::Point2d> points;  // as points_mm()
  double deviation_px = 0;          // standard deviation of a coordinate, from the two halves of the events; frames: 0
  std::string motion;               // kind of Flow; "blinking"; "frame"
  double speed_px_s = 0;
  cv::Mat picture;  // CV_8U, what the board was found on
};

struct BoardSearch {
  std::vector<BoardView> views;
  std::vector<std::string> missed;  // a line per time without a board: the reason and the best candidate
};

// Searches at `count` times spread evenly over the recording. Throws bad_input when none shows the board ("nothing
// found", with the reasons).
BoardSearch find_boards(const events::Recording& recording, const BoardShape& shape, int count,
                        const std::string& file);

// A static board that blinks (white, or black and white alternately). Parts of the recording are the views.
struct Blinking {
  double frequency_hz = 0;
};
BoardSearch find_blinking_boards(const events::Recording& recording, const BoardShape& shape, int count,
                                 const std::string& file, Blinking& blinking);

// Points of the board in a picture (CV_8U, one channel). Empty, with the reason in `why`, when it does not show one.
std::vector<cv::Point2d> board_points(const cv::Mat& picture, const BoardShape& shape, std::string& why);

Json to_json(const BoardSearch& search, const BoardShape& shape);

// The pictures that boards were found on, with their points, on one sheet.
cv::Mat board_picture(const BoardSearch& search, const BoardShape& shape);

}  // namespace pecs::calibration
