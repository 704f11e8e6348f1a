#include <fmt/format.h>

#include <cmath>
#include <sstream>

#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/sensor/stages.h"
#include "pecs/text.h"

namespace pecs::sensor {
namespace {

// The one of the options that is given, by index; throws usage for two.
std::optional<std::size_t> one_of(JsonObject& o, const std::vector<const char*>& keys) {
  std::optional<std::size_t> found;
  for (std::size_t i = 0; i < keys.size(); ++i) {
    if (!o.has(keys[i])) continue;
    if (found) throw Error(ExitCode::usage, fmt::format("{} and {} exclude each other", keys[*found], keys[i]));
    found = i;
  }
  return found;
}

constexpr std::array kTrailKeys = {"trail_us", "stc_us", "stc_keep_us"};  // by TrailFilter
constexpr std::array kAfkKeys = {"afk_hz", "afk_pass_hz"};

}  // namespace

StageOptions read_stage_options(JsonObject& o) {
  StageOptions out;
  if (const auto kind = one_of(o, {kTrailKeys.begin(), kTrailKeys.end()})) {
    out.trail = static_cast<TrailFilter>(*kind);
    out.trail_us = o.integer(kTrailKeys[*kind], static_cast<std::int64_t>(kTrail_us.min),
                             static_cast<std::int64_t>(kTrail_us.max));
  }
  if (const auto kind = one_of(o, {kAfkKeys.begin(), kAfkKeys.end()})) {
    const std::vector<double> band = o.numbers(kAfkKeys[*kind], kAfk_hz);
    if (band.size() != 2 || band[0] >= band[1]) o.fail(kAfkKeys[*kind], "no band", "[low, high]");
    out.afk = Afk{.low_hz = band[0], .high_hz = band[1], .pass = *kind == 1};
  }
  if (o.has("afk_counts")) {
    const std::vector<double> counts = o.numbers("afk_counts", kAfkCounts);
    const auto is_whole = [](double n) { return n == std::floor(n); };
    if (counts.size() != 2 || counts[1] > counts[0] || !std::ranges::all_of(counts, is_whole))
      o.fail("afk_counts", "no such counts", "[start, stop], stop not above start");
    out.afk_counts = AfkCounts{.start = static_cast<int>(counts[0]), .stop = static_cast<int>(counts[1])};
  }
  if (o.has("erc_hz")) out.erc_hz = o.number("erc_hz", kErc_hz);
  if (o.has("mask")) out.mask = o.text("mask");
  if (o.has("roi")) {
    const Json& windows = o.any("roi");
    const auto is_window = [](const Json& w) {
      return w.is_array() && w.size() == 4 &&
             std::ranges::all_of(w, [](const Json& v) { return v.is_number_integer() && v >= 0 && v <= 8192; }) &&
             w[2] > 0 && w[3] > 0;
    };
    if (!windows.is_array() || !std::ranges::all_of(windows, is_window))
      o.fail("roi", windows.dump().substr(0, 60), "[[x, y, width, height], ...] in pixels");
    for (const Json& w : windows) out.roi.push_back({w[0], w[1], w[2], w[3]});
  }
  return out;
}

Json stages_to_json(const StageOptions& s) {
  Json out = Json::object();
  for (const RoiWindow& w : s.roi) out["roi"].push_back({w.x, w.y, w.width, w.height});
  if (s.mask) out["mask"] = s.mask->string();
  if (s.afk) out[kAfkKeys[s.afk->pass]] = {s.afk->low_hz, s.afk->high_hz};
  if (s.afk_counts) out["afk_counts"] = {s.afk_counts->start, s.afk_counts->stop};
  if (s.trail) out[kTrailKeys[static_cast<std::size_t>(*s.trail)]] = s.trail_us;
  if (s.erc_hz > 0) out["erc_hz"] = s.erc_hz;
  return out;
}

std::vector<bool> read_mask(const std::filesystem::path& path, int width, int height) {
  std::istringstream file(read_text(path, std::size_t{64} << 20));
  const auto w = static_cast<std::size_t>(width), h = static_cast<std::size_t>(height);
  std::vector<bool> off(w * h);
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    std::istringstream words(line.substr(0, line.find('#')));
    std::vector<std::string> all;
    for (std::string word; words >> word;) all.push_back(word);
    if (all.empty()) continue;
    const auto place = [&](std::size_t i, std::size_t end) {
      const auto n = i < all.size() ? number_from<std::size_t>(all[i]) : std::nullopt;
      return n && *n < end ? n : std::nullopt;
    };
    const auto x = place(1, w), y = place(all[0] == "pixel" ? 2 : 1, h);
    if (all[0] == "pixel" && all.size() == 3 && x && y) {
      off[*y * w + *x] = true;
    } else if (all[0] == "row" && all.size() == 2 && y) {
      std::fill_n(off.begin() + static_cast<std::ptrdiff_t>(*y * w), width, true);
    } else if (all[0] == "column" && all.size() == 2 && x) {
      for (std::size_t row = 0; row < h; ++row) off[row * w + *x] = true;
    } else {
      throw bad_input(path.string(), fmt::format("line {}", number), line.substr(0, 60),
                      fmt::format("\"pixel X Y\", \"row Y\" or \"column X\" inside {}x{} pixels", width, height));
    }
  }
  return off;
}

}  // namespace pecs::sensor
