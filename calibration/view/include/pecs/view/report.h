#pragma once
// One HTML page that needs nothing else: what was rendered, through which lens, how the sensor sees it, and the
// simulated events beside the recorded ones with their scores. A part that was not given is said to be missing.
#include <filesystem>
#include <optional>

#include "pecs/metrics/compare.h"

namespace pecs::view {

struct ReportInputs {
  std::optional<std::filesystem::path> real, sim;  // event files of one sensor size
  std::optional<std::filesystem::path> stack;      // folder of an EXR stack
  std::optional<std::filesystem::path> lens_svg;   // drawing of the lens (`pecs lens draw`)
  metrics::CompareOptions compare;
};

// Returns what the page says in numbers. Throws pecs::Error; then `output` is not written.
Json write_report(const ReportInputs& inputs, const std::filesystem::path& output);

}  // namespace pecs::view
