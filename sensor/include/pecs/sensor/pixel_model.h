#pragma once
// Pixel models: frames in, events out. `pecs` is ours (models/pecs/); `esim`, `v2e`, `voltmeter` and `icns` are other
// simulators', written from their papers to be compared with (docs/reference/models.md).
//
// To add one:
//   1. src/models/NAME.cpp: a PixelModel and its `extern const ModelEntry kModel_NAME` (src/models/entry.h), with its
//      parameters (unit, default, range, place in the paper) and traits.
//   2. NAME in the list MODELS of sensor/CMakeLists.txt.
//   3. A section in docs/reference/models.md.
// The property suite (tests/sensor/model_test.cpp) runs over all of them.
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "pecs/sensor/chip.h"
#include "pecs/sensor/event_slots.h"

namespace pecs::sensor {

// What a batch of frames brings.
struct FrameBatch {
  std::int64_t first_frame = 0;      // frames given before
  std::vector<const float*> planes;  // each [height * width], row 0 at the top, in the model's range at least
  std::vector<double> t_us;          // of frames first_frame - 2 … (those that exist), then one per plane
  bool last = false;                 // no frame follows: the last interval is finished too
};

// Pixels [first, end), by y * width + x.
struct PixelRange {
  std::uint32_t first = 0, end = 0;
  std::uint32_t size() const { return end - first; }
};

class PixelModel {
 public:
  virtual ~PixelModel() = default;
  // Works through the batch for the pixels of `range` and adds their events; none comes before the start of the
  // interval that makes it. Every batch is given to every pixel once, by any thread; ranges that are worked on at the
  // same time begin at multiples of kBlock, or where the region does that is worked on.
  virtual void advance(const FrameBatch& batch, PixelRange range, EventSlots& events) = 0;
  // Models whose pixels are not independent look at all pixels first, frame by frame: then a batch has one frame.
  virtual void survey(const FrameBatch&, PixelRange) {}
  static constexpr std::uint32_t kBlock = 1024;
};

struct ModelParameter {
  const char* key;
  const char* unit;
  double value, min, max;
  const char* meaning;
};

struct ModelTraits {
  bool takes_light = false;            // photocurrent [fA]; else a grey value of 0 to 255, 255 being white
  bool tells_causes = false;           // why each event came
  bool is_random = true;               // the seed changes its events
  bool pixels_are_independent = true;  // of each other, so that a part of the picture may be worked on alone
};

struct ModelChoice {
  std::string name = "pecs";
  std::map<std::string, double> parameters = {};  // of the model, by key; the others have their defaults
  double white_fa = 0;                            // photocurrent [fA] of the grey value 255; 0: of a plane's value 1
};

std::vector<std::string> model_names();
// These throw usage for an unknown model.
std::span<const ModelParameter> model_parameters(const std::string& model);
const char* model_source(const std::string& model);  // the paper
const ModelTraits& model_traits(const std::string& model);

// unit_fa: photocurrent [fA] of a plane's value 1. `causes`: every event comes with its cause. Throws usage for an
// unknown model or parameter, a value out of range, and for causes of a model that does not tell them.
std::unique_ptr<PixelModel> open_model(const ModelChoice& choice, const Chip& chip, int width, int height,
                                       std::uint64_t seed, double unit_fa, bool causes = false);
// All parameters as resolved, for run records.
Json model_to_json(const ModelChoice& choice);

}  // namespace pecs::sensor
