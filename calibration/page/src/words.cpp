#include <algorithm>
#include <array>
#include <map>
#include <string_view>
#include <utility>

#include "pecs/page/page.h"

namespace pecs::page {

namespace {

using Words = std::pair<std::string_view, std::string_view>;

// Keys whose parts do not say what they mean.
const std::map<std::string_view, std::string_view> kWhole = {
    {"band_edges_nm", "edges of the bands (nm)"},
    {"camera_noise_share", "share of events that another recording would not repeat"},
    {"count", "number"},
    {"dropped", "events that the readout dropped"},
    {"dropped_share", "share of events that the readout dropped"},
    {"e0", "light on the axis per radiance (sr)"},
    {"flow_hidden_or_outside", "share of the flow that ends behind a surface or outside the picture"},
    {"fnumber", "f-number"},
    {"focal_mm", "focal length (mm)"},
    {"fps", "frame rate (Hz)"},
    {"instants", "frames, rendered or not"},
    {"moving_area", "share of the picture that moves"},
    {"noise_share", "share of events from the camera's noise"},
    {"on_share", "share of ON events"},
    {"pixels_with_events", "share of pixels with events"},
    {"rate_hz", "events per second"},
    {"rate_per_pixel_hz", "events per second and pixel"},
    {"render_noise_share", "share of events that another render would not repeat"},
    {"rpm", "turns per minute"},
    {"same_surface", "share of points that both cameras see"},
    {"share_of_pixels", "share of the pixels"},
    {"signal_on_motion", "share of signal events where something moves"},
    {"windows", "compared windows"},
    {"working_fnumber", "f-number at the focus, of each band"},
};

constexpr std::array kStatistics = {
    Words{"_median", ", median"},
    Words{"_p05", ", 5 % are below"},
    Words{"_p95", ", 95 % are below"},
};

// Longer endings first.
constexpr std::array kUnits = {
    Words{"_m_per_s", "m/s"}, Words{"_deg_s", "°/s"}, Words{"_m_s", "m/s"}, Words{"_deg", "°"}, Words{"_lux", "lx"},
    Words{"_px_s", "px/s"},   Words{"_px", "px"},     Words{"_hz", "Hz"},   Words{"_us", "µs"}, Words{"_ms", "ms"},
    Words{"_ns", "ns"},       Words{"_mm", "mm"},     Words{"_um", "µm"},   Words{"_nm", "nm"}, Words{"_pa", "pA"},
    Words{"_m", "m"},         Words{"_s", "s"},       Words{"_a", "A"},
};

constexpr std::array kParts = {
    Words{"rms", "RMS"},
    Words{"imu", "IMU"},
    Words{"sha256", "SHA-256"},
    Words{"fnumber", "f-number"},
    Words{"most", "highest"},
    Words{"least", "lowest"},
    Words{"worst", "largest error"},
    Words{"p90", "90 % are below"},
    Words{"p99", "99 % are below"},
    Words{"qe", "quantum efficiency"},
};

}  // namespace

std::string words_of(std::string_view key) {
  if (const auto whole = kWhole.find(key); whole != kWhole.end()) return std::string(whole->second);
  for (const auto& [ending, words] : kStatistics)
    if (key.size() > ending.size() && key.ends_with(ending))
      return words_of(key.substr(0, key.size() - ending.size())).append(words);
  std::string unit, out;
  for (const auto& [ending, name] : kUnits)
    if (unit.empty() && key.size() > ending.size() && key.ends_with(ending)) {
      unit = name;
      key.remove_suffix(ending.size());
    }
  while (!key.empty()) {
    const std::string_view part = key.substr(0, key.find('_'));
    key.remove_prefix(std::min(key.size(), part.size() + 1));
    std::string_view word = part;
    for (const auto& [short_form, long_form] : kParts)
      if (part == short_form) word = long_form;
    out.append(out.empty() ? "" : " ").append(word);
  }
  return unit.empty() ? out : out + " (" + unit + ")";
}

}  // namespace pecs::page
