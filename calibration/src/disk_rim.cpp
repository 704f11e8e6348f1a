#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "disk_parts.h"

namespace pecs::calibration::disk {

void find_rim(std::span<const Sample> samples, const std::vector<cv::Point2f>& picture, DetectedDisk& disk) {
  constexpr int kWedges = 90, kPerPixel = 4, kReach = 6 * kPerPixel;  // compares the densities 6 px inside and outside
  constexpr double kLeastContrast = 4.5;                              // standard deviations; noise reaches about 4
  const auto farthest = std::max_element(samples.begin(), samples.end(), [&](const Sample& a, const Sample& b) {
    const double cx = disk.centre_x.value, cy = disk.centre_y.value;
    return std::hypot(a.x - cx, a.y - cy) < std::hypot(b.x - cx, b.y - cy);
  });
  const double far = std::hypot(farthest->x - disk.centre_x.value, farthest->y - disk.centre_y.value);
  const int bins = static_cast<int>(far * kPerPixel) + kReach + 2;
  std::vector<std::vector<double>> events(kWedges, std::vector<double>(bins));  // per radius, then cumulative
  for (const Sample& s : samples) {
    const double dx = s.x - disk.centre_x.value, dy = s.y - disk.centre_y.value;
    const int wedge =
        std::min(kWedges - 1, static_cast<int>((std::atan2(dy, dx) / (2 * std::numbers::pi) + 0.5) * kWedges));
    events[wedge][static_cast<int>(std::hypot(dx, dy) * kPerPixel)] += 1;
  }

  // In each wedge the outermost radius where the event density drops: the step of the highest significance.
  std::vector<cv::Point2f> points;
  for (int w = 0; w < kWedges; ++w) {
    auto& sum = events[w];
    for (int i = 1; i < bins; ++i) sum[i] += sum[i - 1];
    const double angle = ((w + 0.5) / kWedges - 0.5) * 2 * std::numbers::pi;
    const auto place = [&](double radius) {
      return cv::Point2f(static_cast<float>(disk.centre_x.value + radius * std::cos(angle)),
                         static_cast<float>(disk.centre_y.value + radius * std::sin(angle)));
    };
    int end = bins;
    while (end > 0 && cv::pointPolygonTest(picture, place(static_cast<double>(end) / kPerPixel), false) < 0) --end;
    double best = kLeastContrast;
    int rim = 0;
    for (int i = kReach + 2; i + kReach < end; ++i) {
      const double r = static_cast<double>(i + 1) / kPerPixel, half = 0.5 * kReach / kPerPixel;
      const double inside = sum[i] - sum[i - kReach], outside = (sum[i + kReach] - sum[i]) * (r - half) / (r + half);
      const double contrast = (inside - outside) / std::sqrt(inside + outside + 1);
      if (contrast > best) best = contrast, rim = i + 1;
    }
    if (rim > 0) points.push_back(place(static_cast<double>(rim) / kPerPixel));
  }

  // Fits an ellipse repeatedly, each time without the outliers.
  for (int pass = 0; pass < 4; ++pass) {
    if (points.size() < 20) {
      disk.rim = {};
      disk.warnings.push_back("rim: too few directions with enough events");
      return;
    }
    disk.rim = cv::fitEllipseDirect(points);
    std::vector<double> off;
    for (const auto& p : points) off.push_back(std::abs(off_ellipse_px(disk.rim, p)));
    std::vector<double> sorted = off;
    std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2), sorted.end());
    const double limit = std::max(0.5, 4 * sorted[sorted.size() / 2]);
    std::vector<cv::Point2f> kept;
    double squares = 0;
    for (std::size_t i = 0; i < points.size(); ++i)
      if (off[i] <= limit) kept.push_back(points[i]), squares += off[i] * off[i];
    disk.rim_rms_px = std::sqrt(squares / static_cast<double>(std::max<std::size_t>(1, kept.size())));
    points = std::move(kept);
  }
}

}  // namespace pecs::calibration::disk
