#include "pecs/error.h"

#include <fmt/format.h>

#include <filesystem>
#include <new>

namespace pecs {
namespace {

bool continues(char c) { return (static_cast<unsigned char>(c) & 0xc0) == 0x80; }

// Bytes of the printable UTF-8 character at the start of `text`; 0 where there is none.
std::size_t printable_bytes(std::string_view text) {
  const auto lead = static_cast<unsigned char>(text[0]);
  if (lead < 0x80) return lead >= 0x20 && lead != 0x7f;
  const std::size_t bytes = lead >= 0xf0 ? 4 : lead >= 0xe0 ? 3 : 2;
  if (lead < 0xc2 || lead > 0xf4 || text.size() < bytes) return 0;
  std::uint32_t code = lead & (0xffu >> (bytes + 1));
  for (std::size_t i = 1; i < bytes; ++i) {
    if (!continues(text[i])) return 0;
    code = code << 6 | (static_cast<unsigned char>(text[i]) & 0x3f);
  }
  const bool overlong = (bytes == 3 && code < 0x800) || (bytes == 4 && code < 0x10000);
  const bool surrogate = code >= 0xd800 && code <= 0xdfff, control = code < 0xa0;
  return overlong || surrogate || control || code > 0x10ffff ? 0 : bytes;
}

}  // namespace

Error::Error(ExitCode code, const std::string& line) : std::runtime_error(printable(line)), code_(code) {}

Error bad_usage(const std::string& option, const std::string& got, const std::string& wanted) {
  return {ExitCode::usage, fmt::format("{}: got {}, wanted {}", option, got, wanted)};
}

Error bad_input(const std::string& file, const std::string& place, const std::string& got, const std::string& wanted) {
  return {ExitCode::bad_input, place.empty() ? fmt::format("{}: got {}, wanted {}", file, got, wanted)
                                             : fmt::format("{}: {}: got {}, wanted {}", file, place, got, wanted)};
}

Error not_found(const std::string& file, const std::string& reason) {
  return {ExitCode::not_found, fmt::format("{}: cannot be opened: {}", file, reason)};
}

Error bad_output(const std::string& file, const std::string& reason) {
  return {ExitCode::bad_output, fmt::format("{}: cannot be written: {}", file, reason)};
}

Error not_in_core(const std::string& what) {
  return {ExitCode::unsupported, what +
                                     ": this build is the core of PECS, without OpenCV; the full program has it "
                                     "(docs/start/install.md)"};
}

Error as_error(const std::exception& e) {
  if (const auto* ours = dynamic_cast<const Error*>(&e)) return *ours;
  if (const auto* files = dynamic_cast<const std::filesystem::filesystem_error*>(&e))
    return not_found(files->path1().string(), files->code().message());
  if (dynamic_cast<const std::bad_alloc*>(&e) || dynamic_cast<const std::length_error*>(&e))
    return {ExitCode::no_memory, "out of memory"};
  return {ExitCode::internal, fmt::format("internal error: {}", e.what())};
}

std::string printable(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  while (!text.empty()) {
    const std::size_t bytes = printable_bytes(text);
    if (bytes > 0)
      out.append(text.substr(0, bytes));
    else
      out += fmt::format("\\x{:02x}", static_cast<unsigned char>(text[0]));
    text.remove_prefix(std::max<std::size_t>(bytes, 1));
  }
  return out;
}

std::string shortened(std::string_view text, std::size_t bytes) {
  if (text.size() <= bytes) return std::string(text);
  while (bytes > 0 && continues(text[bytes])) --bytes;
  return std::string(text.substr(0, bytes)) + "...";
}

}  // namespace pecs
