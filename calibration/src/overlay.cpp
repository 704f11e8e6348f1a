#include <fmt/format.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "camera_axes.h"
#include "pecs/calibration/align.h"
#include "pecs/view/event_pictures.h"

namespace pecs::calibration {
namespace {

constexpr int kRows = 3, kWidth = 800;
const cv::Scalar kOrange(0, 94, 213), kInk(31, 31, 27);

using Line = std::vector<cv::Point3d>;  // right, down, forward in the axes of the unrotated camera [mm]

std::vector<Line> board_outline(const LabScene& s, double right_mm) {
  const double n = s.values.at("squares"), side = s.values.at("square_mm"), down = -s.position_mm()[1],
               z = s.position_mm()[2];
  std::vector<Line> lines;
  for (int i = 0; i <= static_cast<int>(n); ++i) {
    const double o = (i - n / 2) * side, half = n / 2 * side;
    Line across, along;
    for (int k = -8; k <= 8; ++k) {
      across.emplace_back(right_mm + half * k / 8, down + o, z);
      along.emplace_back(right_mm + o, down + half * k / 8, z);
    }
    lines.push_back(across), lines.push_back(along);
  }
  return lines;
}

std::vector<Line> disk_outline(const LabScene& s, double edge_deg) {
  const double r = s.values.at("disk_radius_mm"), x = s.position_mm()[0], y = -s.position_mm()[1],
               z = s.position_mm()[2];
  std::vector<Line> lines(1);
  for (int k = 0; k <= 72; ++k)
    lines[0].emplace_back(x + r * std::cos(k * 5 * kDegree), y + r * std::sin(k * 5 * kDegree), z);
  const int sectors = static_cast<int>(s.values.at("sectors"));
  for (int k = 0; k < sectors; ++k) {
    const double a = (edge_deg + 360.0 * k / sectors) * kDegree;
    lines.push_back({{x, y, z}, {x + r * std::cos(a), y - r * std::sin(a), z}});
  }
  return lines;
}

void draw_outline(cv::Mat& panel, const LabScene& s, double scene_us, const Optics& optics, double times) {
  const cv::Matx33d rotation = matrix_of(rotation_from_blender(s.rotation_deg));
  const double t_s = scene_us * 1e-6;
  const auto lines = s.is_board() ? board_outline(s, s.board().later(t_s).at) : disk_outline(s, s.disk().later(t_s).at);
  for (const Line& line : lines) {
    std::vector<cv::Point> p;
    for (const auto& q : line) {
      const cv::Point2d at = project(optics, rotation, q.x, q.y, q.z) * times;
      p.emplace_back(cvRound(at.x * 16), cvRound(at.y * 16));
    }
    cv::polylines(panel, p, false, kOrange, 1, cv::LINE_AA, 4);
  }
}

// Multiplies the panel by the picture of the events of one colour.
void draw_events(cv::Mat& panel, const events::Recording& recording, double middle_us, std::int64_t window_us,
                 const events::Rgb& colour) {
  const auto from_us = static_cast<std::int64_t>(std::llround(middle_us)) - window_us / 2 - recording.first_us;
  const view::Theme theme{{255, 255, 255}, {27, 31, 36}, colour, colour};
  cv::Mat picture;
  cv::resize(view::event_frame(recording, from_us, from_us + window_us, theme), picture, panel.size(), 0, 0,
             cv::INTER_AREA);
  cv::multiply(panel, picture, panel, 1 / 255.0);
}

}  // namespace

cv::Mat overlay_picture(const events::Recording& real, const LabScene& before, const Aligned& after,
                        const Optics& optics, const events::Recording* sim) {
  const double times = static_cast<double>(kWidth) / real.width;
  const int height = cvRound(real.height * times);
  cv::Mat sheet(kRows * height, 2 * kWidth, CV_8UC3, {255, 255, 255});
  const auto window =
      std::max<std::int64_t>(1, std::min<std::int64_t>(view::readable_window_us(real, 5000), real.span_us / 4));
  for (int row = 0; row < kRows; ++row)
    for (const bool aligned : {false, true}) {
      cv::Mat panel = sheet(cv::Rect(aligned ? kWidth : 0, row * height, kWidth, height));
      const std::int64_t from = (real.span_us - window) * (row + 1) / (kRows + 1);
      const double file_us = static_cast<double>(real.first_us + from) + 0.5 * static_cast<double>(window);
      const double scene_us = aligned ? after.clock_rate * (file_us - after.clock_offset_us) : file_us;
      draw_events(panel, real, file_us, window, view::kLight.on);
      if (aligned && sim)
        draw_events(panel, *sim, scene_us, window, view::kLight.off);
      else
        draw_outline(panel, aligned ? after.scene : before, scene_us, optics, times);
      cv::putText(panel, fmt::format("{}  t = {:.0f} us", aligned ? "aligned" : "before", file_us), {8, 18},
                  cv::FONT_HERSHEY_SIMPLEX, 0.5, kInk, 1, cv::LINE_AA);
    }
  return sheet;
}

}  // namespace pecs::calibration
