#pragma once
// Pixel models: frames in, event keys out. `pecs` is ours (pixel.h); `esim`, `v2e`, `voltmeter` and `icns` are other
// simulators', written from their papers to be compared with (docs/models.md).
//
// To add one: src/model_NAME.cpp with a ModelEntry (its parameters with unit, default, range and place in the paper),
// a line in src/models.h and in pixel_model.cpp, a section in docs/models.md. The property suite
// (tests/sensor/model_test.cpp) runs over all of them.
//
// The other models take pictures, not light: a grey value of 0 to 255, `ModelChoice::white_fa` being 255.
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "pecs/sensor/chip.h"
#include "pecs/sensor/event_key.h"

namespace pecs::sensor {

// What a batch of frames brings. Planes hold photocurrent in any unit: I [fA] = value * gain_fa.
struct FrameBatch {
  std::int64_t first_frame = 0;      // frames given before
  std::vector<const float*> planes;  // each [height * width], row 0 at the top
  std::vector<double> t_us;          // of frames first_frame - 2 … (those that exist), then one per plane
  bool last = false;                 // no frame follows: the last interval is finished too
};

// Throws bad_input unless both sides are 1 to kMaxSide.
void check_size(int width, int height);

class EventSorter;

class PixelModel {
 public:
  virtual ~PixelModel() = default;
  // Works through the batch, in parallel in the caller's TBB arena, and adds its events to the order's tiles. No event
  // comes before the start of the interval that makes it.
  virtual void advance(const FrameBatch& batch, EventSorter& order) = 0;
};

struct ModelParameter {
  const char* key;
  const char* unit;
  double value, min, max;
  const char* meaning;
};

struct ModelEntry;
struct ModelChoice {
  std::string name = "pecs";
  std::map<std::string, double> parameters;  // of the model, by key; the others have their defaults
  double white_fa = 0;                       // photocurrent [fA] of the grey value 255; 0: that of a plane's value 1
};

std::vector<std::string> model_names();
std::span<const ModelParameter> model_parameters(const std::string& model);
const char* model_source(const std::string& model);  // the paper

// `causes`: every event comes with its cause. Throws usage for an unknown model or parameter, a value out of range, and
// for causes of another simulator's model.
std::unique_ptr<PixelModel> open_model(const ModelChoice& choice, const Chip& chip, int width, int height,
                                       std::uint64_t seed, double gain_fa, bool causes = false);
// All parameters as resolved, for run records.
Json model_to_json(const ModelChoice& choice);

}  // namespace pecs::sensor
