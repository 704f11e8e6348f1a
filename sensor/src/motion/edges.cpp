#include "motion/edges.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>

namespace pecs::sensor::motion {
namespace {

// An edge counts in full up to the first limit and not at all beyond the second: rounding errors decide nothing.
struct Limit {
  float full, none;
  float part_of(float value) const { return std::clamp((none - value) / (none - full), 0.0f, 1.0f); }
};
constexpr Limit kTones{0.45f, 0.5f};   // the darker tone over the brighter one; less contrast is left to interpolation
constexpr Limit kError{0.04f, 0.1f};   // largest one of a fit, relative to the difference of the tones
constexpr Limit kMixed{0.05f, 0.15f};  // difference of a pixel from the tone that it shows, relative to the same
constexpr Limit kDistance_px{0.7f, 0.9f};  // of the line from the pixel's centre
constexpr Limit kWidth_px{1, 1.2f};
constexpr float kHopeless = 0.5f;  // error before the fit
constexpr float kLeastWidth_px = 0.05f;
constexpr int kSteps = 3;           // of Gauss and Newton
constexpr float kSure = 0.1f;       // weight of an outline from which on other estimates do not count
constexpr float kFull = 1.0f / 16;  // overlap with pixels at edges from which on only edges count

using Line = Edges::Line;
using Nine = std::array<float, 9>;  // pixels [dy + 1][dx + 1]

// The lines' shares of the brighter tone in each of the 3x3 pixels.
template <std::size_t kLines>
std::array<Nine, kLines> shares(const std::array<Line, kLines>& lines) {
  constexpr std::size_t kCount = 9 * kLines;
  float nx[kCount + kSpare] = {}, ny[kCount + kSpare] = {}, d[kCount + kSpare] = {}, width[kCount + kSpare],
                    out[kCount + kSpare];
  std::fill_n(width, kCount + kSpare, 1.0f);
  for (std::size_t k = 0; k < kCount; ++k) {
    const Line& line = lines[k / 9];
    const auto x = static_cast<float>(static_cast<int>(k % 3) - 1),
               y = static_cast<float>(static_cast<int>(k % 9 / 3) - 1);
    nx[k] = line.nx, ny[k] = line.ny, d[k] = line.d - x * line.nx - y * line.ny, width[k] = line.width;
  }
  line_shares({nx, ny, d, width, kCount}, out);
  std::array<Nine, kLines> found;
  for (std::size_t k = 0; k < kCount; ++k) found[k / 9][k % 9] = out[k];
  return found;
}

Line turned(const Line& line, float angle) {
  const float nx = line.nx - angle * line.ny, ny = line.ny + angle * line.nx, length = std::sqrt(nx * nx + ny * ny);
  return {nx / length, ny / length, line.d, line.width};
}

float worst(const Nine& a, const Nine& b) {
  float out = 0;
  for (std::size_t k = 0; k < 9; ++k) out = std::max(out, std::abs(a[k] - b[k]));
  return out;
}

// One step of Gauss and Newton for angle, distance and width. now: the line's shares.
Line improved(const Line& line, const Nine& now, const Nine& wanted) {
  constexpr float kStep = 0.01f, kDamping = 1e-3f, kMost = 0.5f;
  const std::array<Nine, 3> moved = shares<3>({turned(line, kStep),
                                               {line.nx, line.ny, line.d + kStep, line.width},
                                               {line.nx, line.ny, line.d, line.width + kStep}});
  float m[3][4] = {};
  for (std::size_t k = 0; k < 9; ++k) {
    float slope[3];
    for (std::size_t i = 0; i < 3; ++i) slope[i] = (moved[i][k] - now[k]) / kStep;
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t j = 0; j < 3; ++j) m[i][j] += slope[i] * slope[j];
      m[i][3] += slope[i] * (wanted[k] - now[k]);
    }
  }
  for (int i = 0; i < 3; ++i) m[i][i] += kDamping;
  for (int i = 0; i < 3; ++i)  // elimination; the matrix is positive definite
    for (int j = i + 1; j < 3; ++j) {
      const float part = m[j][i] / m[i][i];
      for (int k = i; k < 4; ++k) m[j][k] -= part * m[i][k];
    }
  float by[3];
  for (int i = 2; i >= 0; --i) {
    by[i] = m[i][3];
    for (int j = i + 1; j < 3; ++j) by[i] -= m[i][j] * by[j];
    by[i] = std::clamp(by[i] / m[i][i], -kMost, kMost);
  }
  Line out = turned(line, by[0]);
  out.d += by[1];
  out.width = std::clamp(out.width + by[2], kLeastWidth_px, kWidth_px.none);
  return out;
}

}  // namespace

// Edges of the pixels of a tile and of the next column and row.
struct Edges::TileEdges {
  static constexpr int kWidth = kTileWidth + 1, kHeight = kTileHeight + 1;
  std::once_flag once;
  std::vector<Edge> edges{{{1, 0, 0, 1}, 0, 0, 0}};                // the first stands for none
  std::array<std::int16_t, std::size_t{kWidth} * kHeight> number;  // of a pixel's edge among them

  static std::size_t place(int column, int row) { return static_cast<std::size_t>(row) * kWidth + column; }
  const Edge& at(int column, int row) const { return edges[static_cast<std::size_t>(number[place(column, row)])]; }
};

Edges::Edges(const float* plane, const Surfaces& from)
    : plane_(plane),
      from_(from),
      tiles_(new TileEdges[static_cast<std::size_t>(from.tiles_x() * from.tiles_y())]),
      near_(static_cast<std::size_t>(from.width()) * static_cast<std::size_t>(from.height())) {}
Edges::~Edges() = default;

// The edge of a pixel that has eight neighbours.
bool Edges::fits(int x, int y, Edge& out) const {
  const int width = from_.width();
  const std::int32_t here = y * width + x;
  Nine light;
  for (int k = 0; k < 9; ++k) light[static_cast<std::size_t>(k)] = plane_[here + (k / 3 - 1) * width + k % 3 - 1];
  float dark = light[0], bright = light[0], sum = 0;
  for (const float one : light) dark = std::min(dark, one), bright = std::max(bright, one), sum += one;
  if (!(dark >= 0 && dark < kTones.none * bright && std::isfinite(sum))) return false;
  const float range = bright - dark;
  Nine share;
  for (std::size_t k = 0; k < 9; ++k) share[k] = (light[k] - dark) / range;
  const float gx = share[0] + 2 * share[3] + share[6] - share[2] - 2 * share[5] - share[8];
  const float gy = share[0] + 2 * share[1] + share[2] - share[6] - 2 * share[7] - share[8];
  const float gradient = std::sqrt(gx * gx + gy * gy);
  if (gradient < 0.5f) return false;
  const bool along_x = std::abs(gx) > std::abs(gy);  // both tones go on, so that they are no mixtures
  const int two = (along_x ? gx : gy) > 0 ? 2 : -2, dx = along_x ? two : 0, dy = along_x ? 0 : two;
  if (std::min(x, y) < 2 || x + 2 >= width || y + 2 >= from_.height()) return false;
  const float further_dark = plane_[here + dy * width + dx], further_bright = plane_[here - dy * width - dx];
  const float mixed = std::max(std::abs(further_dark - dark), std::abs(further_bright - bright)) / range;
  if (!(mixed < kMixed.none)) return false;
  Line line{gx / gradient, gy / gradient, share[4] - 0.5f, kLeastWidth_px};
  Nine now = shares<1>({line})[0];
  if (worst(now, share) > kHopeless) return false;
  for (int step = 0; step < kSteps; ++step) {
    line = improved(line, now, share);
    now = shares<1>({line})[0];
  }
  const float weight = kTones.part_of(dark / bright) * kMixed.part_of(mixed) * kError.part_of(worst(now, share)) *
                       kDistance_px.part_of(std::abs(line.d)) * kWidth_px.part_of(line.width);
  out = {line, dark, range, weight};
  return weight > 0;
}

void Edges::find(int tile, TileEdges& out) const {
  const Tile t = from_.tile(tile);
  Edge edge;
  out.number.fill(0);
  for (int y = std::max(t.y0, 1); y < std::min(t.y0 + TileEdges::kHeight, from_.height() - 1); ++y)
    for (int x = std::max(t.x0, 1); x < std::min(t.x0 + TileEdges::kWidth, from_.width() - 1); ++x)
      if (fits(x, y, edge)) {
        out.number[TileEdges::place(x - t.x0, y - t.y0)] = static_cast<std::int16_t>(out.edges.size());
        out.edges.push_back(edge);
      }
  for (int y = t.y0; y < t.y1; ++y)
    for (int x = t.x0; x < t.x1; ++x) {
      const std::int16_t* number = out.number.data() + TileEdges::place(x - t.x0, y - t.y0);
      const bool any = number[0] || number[1] || number[TileEdges::kWidth] || number[TileEdges::kWidth + 1];
      near_[static_cast<std::size_t>(y) * from_.width() + x].store(any ? kYes : kNo, std::memory_order_relaxed);
    }
}

const Edges::TileEdges& Edges::tile_at(int x, int y) const {
  const int index = y / kTileHeight * from_.tiles_x() + x / kTileWidth;
  TileEdges& tile = tiles_[static_cast<std::size_t>(index)];
  std::call_once(tile.once, [&] { find(index, tile); });
  return tile;
}

const Edges::Edge& Edges::edge_of(std::int32_t index) const {
  const int x = index % from_.width(), y = index / from_.width();
  return tile_at(x, y).at(x % kTileWidth, y % kTileHeight);
}

Edges::Outline Edges::outline(std::int32_t mixed, float u, float v) const {
  const auto [dx, dy] = from_.occluder(mixed);
  const std::int32_t occluder = mixed + dy * from_.width() + dx;
  const std::int32_t of = edge_of(mixed).weight < edge_of(occluder).weight ? occluder : mixed;
  const Edge& edge = edge_of(of);
  const Line& line = edge.line;
  const auto to_line = [&](Vec2 place) {
    const Vec2 centre = from_.position(of);
    return line.d - (place.x - centre.x) * line.nx - (place.y - centre.y) * line.ny;
  };
  const float bright = shares<1>({Line{line.nx, line.ny, to_line({u, v}), line.width}})[0][4];
  const float light = edge.dark + edge.range, weight = std::min(1.0f, edge.weight / kSure);
  if (to_line(from_.position(occluder)) > 0) return {light, edge.dark, bright, weight};
  return {edge.dark, light, 1 - bright, weight};
}

void Edges::sharpen(std::span<const Pixel> pixels) const {
  constexpr std::size_t kCount = 4 * kMost + kSpare;
  float nx[kCount], ny[kCount], d[kCount], width[kCount], share[kCount], dark[kCount], range[kCount], overlap[kCount];
  float* light[kMost];
  std::size_t count = 0;
  for (const Pixel& pixel : pixels) {
    const float left = std::floor(pixel.u), top = std::floor(pixel.v), right = pixel.u - left, low = pixel.v - top;
    const int x = static_cast<int>(left), y = static_cast<int>(top);
    if (x < 0 || y < 0 || x + 1 >= from_.width() || y + 1 >= from_.height() || (right == 0 && low == 0)) continue;
    const TileEdges& tile = tile_at(x, y);
    float sum = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      const std::size_t at = 4 * count + k;
      const float dx = k % 2 ? right - 1 : right, dy = k / 2 ? low - 1 : low;
      const Edge& edge = tile.at(x % kTileWidth + static_cast<int>(k % 2), y % kTileHeight + static_cast<int>(k / 2));
      const Line& line = edge.line;
      nx[at] = line.nx * pixel.by_x.x + line.ny * pixel.by_x.y,
      ny[at] = line.nx * pixel.by_y.x + line.ny * pixel.by_y.y;
      d[at] = line.d - line.nx * dx - line.ny * dy, width[at] = line.width;
      dark[at] = edge.dark, range[at] = edge.range;
      overlap[at] = (1 - std::abs(dx)) * (1 - std::abs(dy)) * edge.weight;
      sum += overlap[at];
    }
    if (sum > 0) light[count++] = pixel.light;
  }
  for (std::size_t at = 4 * count; at < 4 * count + kSpare; ++at) nx[at] = ny[at] = d[at] = width[at] = 1;
  line_shares({nx, ny, d, width, 4 * count}, share);
  for (std::size_t i = 0; i < count; ++i) {
    float sum = 0, weight = 0;
    for (std::size_t at = 4 * i; at < 4 * i + 4; ++at) {
      sum += overlap[at] * (dark[at] + range[at] * share[at]);
      weight += overlap[at];
    }
    *light[i] += std::min(1.0f, weight / kFull) * (sum / weight - *light[i]);
  }
}

}  // namespace pecs::sensor::motion
