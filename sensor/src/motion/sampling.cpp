#include "motion/sampling.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace pecs::sensor::motion {
namespace {

// The kernel's weights.
void b_spline(float x, float (&w)[4]) {
  const float y = 1 - x;
  w[0] = y * y * y / 6;
  w[1] = 2.0f / 3 - x * x * (1 - 0.5f * x);
  w[2] = 2.0f / 3 - y * y * (1 - 0.5f * y);
  w[3] = x * x * x / 6;
}

// Light of a mixed pixel's own surface, from a neighbour on the far side of the occluder that is not mixed, or from the
// occluder's outline.
float behind_of(const Surfaces& from, const float* plane, std::int32_t index, const Edges::Outline& outline) {
  const auto [dx, dy] = from.occluder(index);
  const auto clean = [&](int ox, int oy) {
    return (ox || oy) && from.joined(index, ox, oy) && !(from.flags(index + oy * from.width() + ox) & kMixedPixel);
  };
  for (const auto& [ox, oy] : {std::pair{-dx, -dy}, {-dx, 0}, {0, -dy}, {dy, dx}, {-dy, -dx}})
    if (clean(ox, oy)) return plane[index + oy * from.width() + ox];
  return plane[index] + outline.weight * (outline.back - plane[index]);
}

}  // namespace

SplinePlane::SplinePlane(const float* plane, const Surfaces& from)
    : plane_(plane),
      width_(from.width()),
      height_(from.height()),
      coefficients_(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_) + kSpare),
      edges_(std::make_unique<Edges>(plane, from)) {
  const int width = width_, height = height_;
  constexpr int kReach = kSplineTaps / 2;
  std::vector<float> along_rows(coefficients_.size());
  const auto row_of = [&](auto* values, int y) { return values + static_cast<std::ptrdiff_t>(y) * width; };
  tbb::parallel_for(0, height, [&](int y) {
    std::vector<float> row(static_cast<std::size_t>(width + 2 * kReach) + kSpare), out(row.size());
    float* own = row.data() + kReach;
    for (int x = 0; x < width; ++x) {
      const float value = row_of(plane, y)[x];
      own[x] = std::isfinite(value) ? value : x > 0 ? own[x - 1] : 0;
    }
    std::fill_n(row.begin(), kReach, row[kReach]);
    std::fill_n(row.begin() + width + kReach, kReach, row[static_cast<std::size_t>(width + kReach - 1)]);
    const float* taps[kSplineTaps];
    for (int k = 0; k < kSplineTaps; ++k) taps[k] = row.data() + k;
    spline_run(taps, static_cast<std::size_t>(width), out.data());
    std::copy_n(out.begin(), width, row_of(along_rows.data(), y));
  });
  tbb::parallel_for(0, height, [&](int y) {
    std::vector<float> out(static_cast<std::size_t>(width) + kSpare);
    const float* taps[kSplineTaps];
    for (int k = 0; k < kSplineTaps; ++k)
      taps[k] = row_of(along_rows.data(), std::clamp(y + k - kReach, 0, height - 1));
    spline_run(taps, static_cast<std::size_t>(width), out.data());
    std::copy_n(out.begin(), width, row_of(coefficients_.data(), y));
  });
}

float SplinePlane::at(float u, float v) const {
  const int x = static_cast<int>(std::floor(u)), y = static_cast<int>(std::floor(v));
  float wx[4], wy[4];
  b_spline(u - static_cast<float>(x), wx);
  b_spline(v - static_cast<float>(y), wy);
  float sum = 0, least = std::numeric_limits<float>::infinity(), most = -least, all = 0;
  for (int j = 0; j < 4; ++j)
    for (int i = 0; i < 4; ++i) {
      const std::ptrdiff_t k = static_cast<std::ptrdiff_t>(std::clamp(y - 1 + j, 0, height_ - 1)) * width_ +
                               std::clamp(x - 1 + i, 0, width_ - 1);
      sum += wy[j] * wx[i] * coefficients_[static_cast<std::size_t>(k)];
      if (i % 3 == 0 || j % 3 == 0) continue;
      least = std::min(least, plane_[k]), most = std::max(most, plane_[k]);
      all += std::abs(plane_[k]);
    }
  if (!std::isfinite(all)) return kDark;
  if (u == static_cast<float>(x) && v == static_cast<float>(y) && x >= 0 && y >= 0 && x < width_ && y < height_)
    return plane_[static_cast<std::ptrdiff_t>(y) * width_ + x];
  const float beyond = kBeyond * (most - least);
  return std::clamp(sum, std::max(least - beyond, (1 - kBeyond) * least), most + beyond);
}

SampledLight own_light(const Surfaces& from, const SplinePlane& spline, const VisiblePoint& seen) {
  const float* plane = spline.plane();
  const std::int32_t index = seen.index;
  const Vec2 point = from.position(index);
  const float u = seen.u - point.x, v = seen.v - point.y;
  const int dx = u < 0 ? -1 : 1, dy = v < 0 ? -1 : 1;
  const float fu = std::min(std::abs(u), 1.0f), fv = std::min(std::abs(v), 1.0f);
  float sum = 0, weight = 0;
  const auto add = [&](int ox, int oy, float w) {
    if (w == 0 || ((ox || oy) && !from.joined(index, ox, oy))) return;
    const std::int32_t at = index + oy * from.width() + ox;
    if (from.flags(at) & kMixedPixel || !std::isfinite(plane[at])) return;
    sum += w * plane[at];
    weight += w;
  };
  add(0, 0, (1 - fu) * (1 - fv));
  add(dx, 0, fu * (1 - fv));
  add(0, dy, (1 - fu) * fv);
  add(dx, dy, fu * fv);
  if (weight > 0.05f) return {sum / weight, false};
  if (!(from.flags(index) & kMixedPixel)) return {plane[index], true};
  return {behind_of(from, plane, index, spline.edges().outline(index, seen.u, seen.v)), true};
}

float boundary_light(const Surfaces& from, const SplinePlane& spline, const VisiblePoint& boundary, float behind) {
  const float* plane = spline.plane();
  const Edges::Outline outline = spline.edges().outline(boundary.index, boundary.u, boundary.v);
  const float back = behind_of(from, plane, boundary.index, outline);
  if (!std::isfinite(behind)) behind = back;
  const auto [dx, dy] = from.occluder(boundary.index);
  const std::int32_t occluder = boundary.index + dy * from.width() + dx;
  const float front = plane[from.joined(occluder, dx, dy) ? occluder + dy * from.width() + dx : occluder];
  const float light = spline.at(boundary.u, boundary.v);
  if (!std::isfinite(front + back + light)) return kDark;
  // Coverage of the pixel by the occluder, whose edge is taken perpendicular to the line between the two pixels'
  // centres. Its position on that line follows from the coverage of both pixels, estimated from their light.
  const auto fx = static_cast<float>(dx), fy = static_cast<float>(dy), length = std::sqrt(fx * fx + fy * fy);
  const Vec2 point = from.position(occluder);
  const float u = boundary.u - point.x, v = boundary.v - point.y;
  float covered = 1;
  if (std::abs(front - back) > 0.05f * std::max(front, back)) {
    const auto part_of = [&](std::int32_t at) { return std::clamp((plane[at] - back) / (front - back), 0.0f, 1.0f); };
    covered = part_of(occluder) + part_of(boundary.index);
  }
  const float part = std::clamp(covered + (u * fx + v * fy) / (length * length), 0.0f, 1.0f);
  // High coverage: the keyframe's light with its background exchanged. Low coverage: composed of front and background.
  const float exchanged = light + (1 - part) * (behind - back), composed = part * front + (1 - part) * behind;
  const float estimated = std::max(0.0f, part * exchanged + (1 - part) * composed);
  const float drawn = outline.share * outline.front + (1 - outline.share) * behind;
  return estimated + outline.weight * (drawn - estimated);
}

float blend(float a, float b, float s) {
  if (a == b || !std::isfinite(b)) return a;
  if (!std::isfinite(a)) return b;
  if (!(a > 0 && b > 0)) return a + s * (b - a);
  return a * std::exp(s * std::log(b / a));
}

}  // namespace pecs::sensor::motion
