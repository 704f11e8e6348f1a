#pragma once
// Pixel models: frames in, events out. `pecs` is PECS's own model (models/pecs/); the others are those of other
// simulators, written from their papers for comparison (docs/reference/models.md).
//
// To add one:
//   1. src/models/NAME.cpp: a PixelModel and its `extern const ModelEntry kModel_NAME` (src/models/entry.h), with its
//      parameters (unit, default, range, place in the paper) and traits.
//      A model that works frame by frame takes its loop from src/models/frame_by_frame.h.
//   2. The file in the list MODELS of sensor/CMakeLists.txt, the entry in kModels of src/models/pixel_model.cpp.
//   3. A row in docs/reference/models.md.
// The property suite (tests/sensor/model_test.cpp) runs over all of them. A model in Python or C needs none of this:
// UserModel.
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "pecs/sensor/chip.h"
#include "pecs/sensor/event_slots.h"

namespace pecs::sensor {

// An exposure of the chip's own frames, in row 0.
struct ChipExposure {
  std::int64_t frame;
  double begin_us, end_us;
};

// A batch of frames.
struct FrameBatch {
  std::int64_t first_frame = 0;      // number of frames in earlier batches
  std::vector<const float*> planes;  // each [height * width], row 0 at the top, in the model's range at least
  std::vector<double> t_us;          // of frames first_frame - 2 … (those that exist), then one per plane
  bool last = false;                 // no frame follows: the last interval is finished too
  // Exposures that some row has within t_us; none unless the chip takes frames.
  std::vector<ChipExposure> exposures = {};
};

// Pixels [first, end), by y * width + x.
struct PixelRange {
  std::uint32_t first = 0, end = 0;
  std::uint32_t size() const { return end - first; }
};

class PixelModel {
 public:
  virtual ~PixelModel() = default;
  // Processes the batch for the pixels of `range` and adds their events; no event is earlier than the start of its
  // interval. Every pixel gets every batch once, from any thread; concurrent ranges begin at multiples of kBlock or at
  // the start of the region.
  virtual void advance(const FrameBatch& batch, PixelRange range, EventSlots& events) = 0;
  // Called for all pixels before advance(), frame by frame, if the model's pixels are not independent; its batches have
  // one frame.
  virtual void survey(const FrameBatch&, PixelRange) {}
  static constexpr std::uint32_t kBlock = 1024;
};

struct ModelParameter {
  const char* key;
  const char* unit;
  double value, min, max;
  const char* meaning;
  bool is_noise = false;  // 0, or the nearest value in its range, turns noise of the model's own off
};

struct ModelTraits {
  bool takes_light = false;            // photocurrent [fA]; otherwise a grey value from 0 to 255 (white)
  bool tells_causes = false;           // labels each event with its cause
  bool is_random = true;               // the seed changes the events
  bool takes_noise_seed = false;       // ModelChoice::noise_seed changes the noise, and nothing else
  bool pixels_are_independent = true;  // of each other, so that a region may be simulated on its own
  bool in_tiles = true;                // false: advance() gets all pixels at once, in the caller's thread
};

// A pixel model from outside the library. PECS calls it once per interval, frame by frame and one call at a time, and
// checks what it returns.
struct UserEvent {
  double t_us, x, y, on, cause;  // on: 1 or 0; cause: a number of Cause, 0 without tells_causes
};
class UserModel {
 public:
  virtual ~UserModel() = default;
  // Events of the interval, in any order: at or after its begin, at most kMostDelay_us after its end. They are valid
  // until the next call. planes: [2][height][width], the light at its begin and end; t_us: both times.
  virtual std::span<const UserEvent> interval(std::span<const float> planes, std::span<const double, 2> t_us) = 0;
  static constexpr double kMostDelay_us = 1e4;
};
struct UserModelEntry {
  bool takes_light = true;  // photocurrent [A]; otherwise grey values from 0 to 255 (white)
  bool tells_causes = false;
  // setup: {"width", "height", "seed", "chip": as chip_to_json, "parameters": {"key": number}}
  std::function<std::unique_ptr<UserModel>(const Json& setup)> begin;
};

struct ModelChoice {
  std::string name = "pecs";
  std::map<std::string, double> parameters = {};  // of the model, by key; defaults for those left out
  double white_fa = 0;                            // photocurrent [fA] of the grey value 255; 0: of a plane's value 1
  // Pixels of `pecs` begin at random distances from their thresholds, as pixels that have been on, instead of at rest.
  bool random_phase = false;
  // Seed of the temporal noise, for another recording by the same pixels; by default the common seed.
  std::optional<std::uint64_t> noise_seed = {};
  std::shared_ptr<const UserModelEntry> user = {};  // then `name` is for messages and records, `parameters` are its own
};

std::vector<std::string> model_names();
// These throw usage for an unknown model.
std::span<const ModelParameter> model_parameters(const std::string& model);
const char* model_source(const std::string& model);  // the paper
ModelTraits model_traits(const ModelChoice& model);

// unit_fa: photocurrent [fA] of a plane's value 1. `causes`: events are labelled with their causes. Throws usage for an
// unknown model or parameter, a value out of range, and for causes of a model without tells_causes.
std::unique_ptr<PixelModel> open_model(const ModelChoice& choice, const Chip& chip, int width, int height,
                                       std::uint64_t seed, double unit_fa, bool causes = false);
// All parameters as resolved, for run records.
Json model_to_json(const ModelChoice& choice);

}  // namespace pecs::sensor
