#pragma once
// The chip's digital stages that drop events, as Metavision's users configure them (docs/reference/sensor.md): region
// of interest before the readout; event mask, anti-flicker (AFK), trail filter (Trail, STC) and event rate control
// (ERC) after it, in this order. Each decides by the events so far, so chunks change nothing; ERC holds at most
// one reference period of events.
#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "pecs/sensor/readout.h"
#include "pecs/strict_json.h"

namespace pecs::sensor {

// The stage that dropped an event. The numbers are those of the file of dropped events.
enum class Stage : std::uint8_t { none, roi, mask, afk, trail, erc };
inline constexpr std::array kStageNames = {"none", "roi", "mask", "afk", "trail", "erc"};
using StageCounts = std::array<std::int64_t, kStageNames.size()>;

struct RoiWindow {
  int x = 0, y = 0, width = 0, height = 0;
};

// Blocks of 4x4 pixels whose pixels alternate between ON and OFF with a period in the band.
struct Afk {
  double low_hz = 0, high_hz = 0;
  bool pass = false;  // keeps only their events, instead of dropping them
};
struct AfkCounts {
  int start = 6;  // counted periods after which a block flickers
  int stop = 4;   // it does so until fewer are left; each longest period without one takes one off
};

// A burst is events of one pixel and polarity, each less than the threshold after the one before.
enum class TrailFilter { first, second, all_but_first };  // Trail, STC, STC that keeps the trail

struct StageOptions {
  std::vector<RoiWindow> roi;  // pixels outside all windows are off; empty: none is
  std::optional<std::filesystem::path> mask;
  std::optional<Afk> afk;
  std::optional<AfkCounts> afk_counts{};  // only with afk
  std::optional<TrailFilter> trail;
  std::int64_t trail_us = 10'000;
  double erc_hz = 0;  // 0: no limit

  bool any() const { return !roi.empty() || mask || afk || afk_counts || trail || erc_hz > 0; }
};

inline constexpr std::int64_t kErcPeriod_us = 200;
inline constexpr Range kTrail_us{1'000, 100'000}, kAfk_hz{50, 520}, kAfkCounts{1, 7}, kErc_hz{5e3, 3.2e9};

// Options in JSON: "trail_us", "stc_us" or "stc_keep_us"; "afk_hz" or "afk_pass_hz": [low, high], and "afk_counts":
// [start, stop]; "erc_hz"; "roi": [[x, y, width, height], ...]; "mask": a file. Throws usage for two that exclude each
// other.
StageOptions read_stage_options(JsonObject& object);
Json stages_to_json(const StageOptions& options);

// Pixels that are off, row by row. The file has lines "pixel X Y", "row Y" and "column X", and comments from '#' on.
std::vector<bool> read_mask(const std::filesystem::path& file, int width, int height);

struct DroppedEvent {
  events::Event event;
  Stage stage = Stage::none;
};

class EventStages {
 public:
  // Throws bad_input for a mask or window beyond the picture.
  EventStages(const StageOptions& options, int width, int height);
  ~EventStages();
  // The periods of ERC are counted from this time (default: 0).
  void begin_at(std::int64_t t_us) { begin_us_ = t_us; }
  // Both remove the events that a stage drops, and append them to `dropped` if it is given.
  void before_readout(LabelledEvents& events, std::vector<DroppedEvent>* dropped = nullptr);
  // With ERC, holds the events of the last period until the next begins or `last`. Throws bad_input for events outside
  // the picture.
  void after_readout(LabelledEvents& events, bool last, std::vector<DroppedEvent>* dropped = nullptr);
  const StageCounts& counts() const { return counts_; }

 private:
  class Blocks;
  class Bursts;
  struct Held {
    events::Event event;
    Cause cause;
    Stage stage;
  };
  Stage stage_of(const events::Event& e);
  void release(LabelledEvents& out, std::vector<DroppedEvent>* dropped);

  int width_, height_;
  std::vector<bool> outside_, masked_;  // empty: no pixel is
  std::unique_ptr<Blocks> afk_;
  std::unique_ptr<Bursts> trail_;
  std::int64_t most_ = 0;  // events per reference period; 0: no limit
  std::int64_t begin_us_ = 0;
  std::vector<Held> held_;
  StageCounts counts_{};
};

Json counts_to_json(const StageCounts& counts);

}  // namespace pecs::sensor
