// Labels of the points visible between two keyframes.
#include <tbb/parallel_for.h>

#include <numeric>
#include <vector>

#include "motion/keyframe_interval.h"
#include "motion/view.h"
#include "pecs/sensor/motion.h"

namespace pecs::sensor {

using namespace motion;

namespace {

struct Planes {
  const std::int32_t *first, *second;
  std::int32_t nearer_in_time(std::int32_t pixel, double s) const { return (s < 0.5 ? first : second)[pixel]; }
  std::int32_t unseen(std::int32_t pixel) const { return first[pixel] == second[pixel] ? first[pixel] : 0; }
};

// Label of a tile's pixel from both keyframes.
std::int32_t label(const Planes& planes, const View& a, const View& b, std::size_t slot, std::int32_t pixel, double s) {
  const std::int32_t i = a.landing.points.index[slot], k = b.landing.points.index[slot];
  if (i == kNone && k == kNone) return planes.unseen(pixel);
  if (k == kNone || (i != kNone && s < 0.5)) return planes.first[i];
  return planes.second[k];
}

}  // namespace

void Carrier::labels(const std::int32_t* first, const std::int32_t* second, std::span<const Sight> sights,
                     std::span<std::int32_t> out) const {
  const KeyframeInterval& in = *interval_;
  const int width = in.first.width(), tiles_x = in.first.tiles_x();
  const Planes planes{first, second};

  // Groups the sights by tile and keeps their order.
  const auto tile_of = [&](const Sight& sight) {
    const auto row = static_cast<std::size_t>(sight.pixel / width / kTileHeight);
    return row * static_cast<std::size_t>(tiles_x) + static_cast<std::size_t>(sight.pixel % width / kTileWidth);
  };
  std::vector<std::size_t> begin(in.near.size() + 1), of_tiles(sights.size());
  for (const Sight& sight : sights) ++begin[tile_of(sight) + 1];
  std::partial_sum(begin.begin(), begin.end(), begin.begin());
  std::vector<std::size_t> next(begin.begin(), begin.end() - 1);
  for (std::size_t i = 0; i < sights.size(); ++i) of_tiles[next[tile_of(sights[i])]++] = i;

  tbb::parallel_for(std::size_t{0}, in.near.size(), [&](std::size_t t) {
    if (begin[t] == begin[t + 1]) return;
    const KeyframeInterval::Near& near = in.near[t];
    const Tile tile = in.first.tile(static_cast<int>(t));
    View a(in.first), b(in.second);
    double seen = -1;  // fraction that the views are of
    for (std::size_t k = begin[t]; k < begin[t + 1]; ++k) {
      const auto [pixel, s] = sights[of_tiles[k]];
      std::int32_t& to = out[of_tiles[k]];
      if (s <= 0 || s >= 1 || near.still) {
        to = planes.nearer_in_time(pixel, s);
        continue;
      }
      if (s != seen) {
        a.look(Weights(s), tile, near.first);
        b.look(Weights(1 - s), tile, near.second);
        drop_hidden(a.landing.points, b.landing.points);
        seen = s;
      }
      to = label(planes, a, b, Landing::slot(pixel % width - tile.x0, pixel / width - tile.y0), pixel, s);
    }
  });
}

}  // namespace pecs::sensor
