#pragma once
// Calibration boards in events and in frames: checkerboards, grids of circles; moving or blinking.
//
// Points are pixels, (0.5, 0.5) the centre of the top left one; they come row by row as on the upright board, which is
// the reading nearest to how it stands in the picture (a board without marks looks the same upside down).
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "pecs/calibration/motion.h"
#include "pecs/strict_json.h"
#include "pecs/view/event_pictures.h"

namespace pecs::calibration {

enum class Pattern { checkerboard, circles, asymmetric_circles };
Pattern pattern_from(const std::string& name);  // "checkerboard", "circles", "asymmetric-circles"; throws usage

struct BoardShape {
  Pattern pattern = Pattern::checkerboard;
  int columns = 0, rows = 0;  // inner corners, or circles, along a row and a column (asymmetric: OpenCV's count)
  double spacing_mm = 1;      // of neighbours; asymmetric: from a row to the next
  std::vector<cv::Point3d> points_mm() const;  // x right, y down, z = 0, the middle of the board at 0
  std::string text() const;                    // "checkerboard of 3 x 3 inner corners"
};

struct BoardView {
  double t_us = 0;                  // when the points were there, clock of the file
  std::vector<cv::Point2d> points;  // as points_mm()
  double deviation_px = 0;          // standard deviation of a coordinate, from both halves of the events; frames: 0
  std::string motion;               // kind of Flow; "blinking"; "frame"
  double speed_px_s = 0;
  cv::Mat picture;  // CV_8U, what the board was found on
};

struct BoardSearch {
  std::vector<BoardView> views;
  std::vector<std::string> missed;  // a line for each look without a board: why, and the best candidate
};

// Looks at `count` instants spread evenly over the recording. Throws bad_input when none shows the board ("nothing
// found", with the reasons).
BoardSearch find_boards(const events::Recording& recording, const BoardShape& shape, int count,
                        const std::string& file);

// A board that stands still and blinks (white, or black and white in turn). Parts of the recording are views.
struct Blinking {
  double frequency_hz = 0;
};
BoardSearch find_blinking_boards(const events::Recording& recording, const BoardShape& shape, int count,
                                 const std::string& file, Blinking& blinking);

// In a picture (CV_8U, one channel). Empty, with `why`, when it does not show the board.
std::vector<cv::Point2d> board_points(const cv::Mat& picture, const BoardShape& shape, std::string& why);

Json to_json(const BoardSearch& search, const BoardShape& shape);

// The pictures that boards were found on, with their points, on one sheet.
cv::Mat board_picture(const BoardSearch& search, const BoardShape& shape);

}  // namespace pecs::calibration
