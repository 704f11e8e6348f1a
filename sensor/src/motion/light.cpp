#include "motion/light.h"

#include <algorithm>
#include <cmath>

namespace pecs::sensor::motion {
namespace {

// As the kernel's.
void catmull_rom(float x, float (&w)[4]) {
  const float y = 1 - x, xy = 0.5f * x * y;
  w[0] = -xy * y;
  w[1] = y * (1 + x * (1 - 1.5f * x));
  w[2] = x * (1 + y * (1 - 1.5f * y));
  w[3] = -xy * x;
}

// Light of the surface a soiled pixel shows, from where nothing else is in it: away from the nearer surface.
float behind_of(const Surfaces& from, const float* plane, std::int32_t index) {
  const auto [dx, dy] = from.owner(index);
  const auto clean = [&](int ox, int oy) {
    return (ox || oy) && from.joined(index, ox, oy) && !(from.flags(index + oy * from.width() + ox) & kSoiled);
  };
  for (const auto& [ox, oy] : {std::pair{-dx, -dy}, {-dx, 0}, {0, -dy}, {dy, dx}, {-dy, -dx}})
    if (clean(ox, oy)) return plane[index + oy * from.width() + ox];
  return plane[index];
}

}  // namespace

float cubic(const Surfaces& from, const float* plane, float u, float v) {
  const int width = from.width(), height = from.height();
  const int x = static_cast<int>(std::floor(u)), y = static_cast<int>(std::floor(v));
  float wx[4], wy[4];
  catmull_rom(u - static_cast<float>(x), wx);
  catmull_rom(v - static_cast<float>(y), wy);
  float sum = 0, least = std::numeric_limits<float>::infinity(), most = -least;
  for (int j = 0; j < 4; ++j) {
    const float* row = plane + static_cast<std::ptrdiff_t>(std::clamp(y - 1 + j, 0, height - 1)) * width;
    float part = 0;
    for (int i = 0; i < 4; ++i) {
      const float value = row[std::clamp(x - 1 + i, 0, width - 1)];
      part += wx[i] * value;
      if ((i == 1 || i == 2) && (j == 1 || j == 2)) least = std::min(least, value), most = std::max(most, value);
    }
    sum += wy[j] * part;
  }
  return std::isfinite(sum) ? std::clamp(sum, least, most) : kDark;
}

Light own_light(const Surfaces& from, const float* plane, const Seen& seen) {
  const std::int32_t index = seen.index;
  const float u = seen.u - static_cast<float>(index % from.width()),
              v = seen.v - static_cast<float>(index / from.width());
  const int dx = u < 0 ? -1 : 1, dy = v < 0 ? -1 : 1;
  const float fu = std::min(std::abs(u), 1.0f), fv = std::min(std::abs(v), 1.0f);
  float sum = 0, weight = 0;
  const auto add = [&](int ox, int oy, float w) {
    if (w == 0 || ((ox || oy) && !from.joined(index, ox, oy))) return;
    const std::int32_t at = index + oy * from.width() + ox;
    if (from.flags(at) & kSoiled || !std::isfinite(plane[at])) return;
    sum += w * plane[at];
    weight += w;
  };
  add(0, 0, (1 - fu) * (1 - fv));
  add(dx, 0, fu * (1 - fv));
  add(0, dy, (1 - fu) * fv);
  add(dx, dy, fu * fv);
  if (weight > 0.05f) return {sum / weight, false};
  return {from.flags(index) & kSoiled ? behind_of(from, plane, index) : plane[index], true};
}

float rim_light(const Surfaces& from, const float* plane, const Seen& rim, float behind) {
  const auto [dx, dy] = from.owner(rim.index);
  const std::int32_t owner = rim.index + dy * from.width() + dx;
  const float front = plane[from.joined(owner, dx, dy) ? owner + dy * from.width() + dx : owner];
  const float back = behind_of(from, plane, rim.index), light = cubic(from, plane, rim.u, rim.v);
  if (!std::isfinite(front + back + light)) return kDark;
  if (!std::isfinite(behind)) behind = back;
  // The part of the pixel that the nearer surface covers: by its light, or by how far its last centre is.
  float part = (light - back) / (front - back);
  if (!(std::abs(front - back) > 0.05f * std::max(front, back))) {
    const auto fx = static_cast<float>(dx), fy = static_cast<float>(dy);
    const float u = rim.u - static_cast<float>(rim.index % from.width()),
                v = rim.v - static_cast<float>(rim.index / from.width());
    part = (u * fx + v * fy) / (fx * fx + fy * fy);
  }
  part = std::clamp(part, 0.0f, 1.0f);
  // Where it covers much, the keyframe's own light with another background; where little, the background now.
  const float exchanged = light + (1 - part) * (behind - back), composed = part * front + (1 - part) * behind;
  return std::max(0.0f, part * exchanged + (1 - part) * composed);
}

float blend(float a, float b, float s) {
  if (a == b || !std::isfinite(b)) return a;
  if (!std::isfinite(a)) return b;
  if (!(a > 0 && b > 0)) return a + s * (b - a);
  return a * std::exp(s * std::log(b / a));
}

}  // namespace pecs::sensor::motion
