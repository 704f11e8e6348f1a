#pragma once
// A self-contained HTML page: render, lens, sensor response, and simulated next to recorded events with their scores.
// Missing parts are listed as missing.
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

// Returns the numbers of the page. Throws pecs::Error; then `output` is not written.
Json write_report_page(const ReportInputs& inputs, const std::filesystem::path& output);

}  // namespace pecs::view
