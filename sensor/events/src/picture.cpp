#include "pecs/events/picture.h"

#include <fmt/format.h>

#include <cmath>

#include "pecs/error.h"

namespace pecs::events {

std::string Rgb::hex() const { return fmt::format("#{:02x}{:02x}{:02x}", r, g, b); }

const Theme& theme_of(const std::string& name) {
  if (name != "light" && name != "dark")
    throw Error(ExitCode::usage, fmt::format("theme: got {}, wanted light or dark", name));
  return name == "dark" ? kDark : kLight;
}

std::vector<Rgb> picture(std::span<const Event> events, int width, int height, const Theme& theme, int binning) {
  const auto columns = static_cast<std::size_t>((width + binning - 1) / binning);
  const auto rows = static_cast<std::size_t>((height + binning - 1) / binning);
  std::vector<std::array<std::uint32_t, 2>> counts(columns * rows);
  for (const Event& e : events) {
    if (e.x >= width || e.y >= height)
      throw bad_input("events", "pixel", fmt::format("({}, {})", e.x, e.y), fmt::format("one of {}x{}", width, height));
    ++counts[static_cast<std::size_t>(e.y / binning) * columns + static_cast<std::size_t>(e.x / binning)][e.p != 0];
  }

  std::vector<Rgb> out;
  out.reserve(counts.size());
  for (const auto& count : counts) {
    const double off = count[0], on = count[1], total = off + on, strength = 1 - std::pow(0.3, total);
    const auto mixed = [&](double paper, double of_off, double of_on) {
      const double hue = total > 0 ? (off * of_off + on * of_on) / total : paper;
      return static_cast<std::uint8_t>(std::lround(paper + strength * (hue - paper)));
    };
    const Rgb &of_none = theme.paper, &of_off = theme.off, &of_on = theme.on;
    out.push_back({mixed(of_none.r, of_off.r, of_on.r), mixed(of_none.g, of_off.g, of_on.g),
                   mixed(of_none.b, of_off.b, of_on.b)});
  }
  return out;
}

}  // namespace pecs::events
