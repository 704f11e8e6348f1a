#pragma once
// Text of files, pages and command lines.
#include <charconv>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace pecs {

// In ASCII.
std::string lower(std::string text);

// The number that is all of `text`; none for anything else, or beyond the type's range.
template <class Number>
std::optional<Number> number_from(std::string_view text) {
  Number value{};
  const auto [end, ec] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (ec != std::errc() || end != text.data() + text.size()) return {};
  return value;
}

// Text as it stands in HTML and SVG.
std::string html_escaped(std::string_view text);
std::string base64(std::span<const std::uint8_t> bytes);

}  // namespace pecs
