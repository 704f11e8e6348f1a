#pragma once
// Photocurrent in the order of time, batch by batch. In the caller's TBB arena.
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "pecs/sensor/photocurrent.h"
#include "pecs/sensor/timeline.h"

namespace pecs::sensor {

// How many planes a batch holds depends on memory, threads and motion, and says nothing: one at least.
struct LightBatch {
  std::vector<const float*> planes;  // [fA], indexed by the pixel in the whole picture; valid until the sink returns
  std::vector<double> t_us;
  std::int64_t steps = 0;  // of the timeline, up to the end of this batch
  bool last = false;
  std::vector<const float*> again{};  // planes of a second reader, or none
};
using LightSink = std::function<bool(const LightBatch&)>;  // false: no further batches

// Rows of the source's frames. The next batch is decoded while one is worked on; a loop that fits into kLoopBytes is
// decoded once.
void feed_frames(const Timeline& timeline, PhotocurrentReader& light, Region region, const LightSink& sink);

// Whole pictures at the source's instants and between them, warped along its motion so often that nothing moves more
// than about half a pixel from plane to plane. The next interval is read while one is worked on, unless it has
// subpixels: two would hold too much memory. A loop whose planes fit into loop_bytes is computed once. again: a second
// reader of the same source, or none.
inline constexpr std::size_t kMovingLoopBytes = std::size_t{1} << 30;
void feed_moving(const Timeline& timeline, PhotocurrentReader& light, PhotocurrentReader* again, const LightSink& sink,
                 std::size_t loop_bytes = kMovingLoopBytes);

}  // namespace pecs::sensor
