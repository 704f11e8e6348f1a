#pragma once
// The text header of Prophesee RAW and DAT files: lines "% key value", RAW ends them with "% end".
#include <map>
#include <span>
#include <string>

#include "pecs/events/format.h"

namespace pecs::events {

constexpr std::size_t kHeadBytes = 1 << 16;  // a longer header is refused

struct RawHeader {
  std::map<std::string, std::string> fields;   // keys in lower case
  std::size_t bytes = 0;                       // of the header; the data begin here
  std::string encoding;                        // "EVT3", … or another value in the file; empty without one
  std::map<std::string, std::string> options;  // of the format line: height, width, endianness
  StreamInfo info;
};

RawHeader parse_raw_header(std::span<const std::byte> head);
// "EVT2" or "EVT3" by the words behind the header, for a file that does not name its encoding; then by the camera's
// generation. Empty if they leave it open.
std::string raw_encoding(std::span<const std::byte> head);
// The header of a RAW file of `info`'s size, including "% end".
std::string raw_header_text(const std::string& encoding, const std::string& evt, const StreamInfo& info,
                            const std::string& options = "");

}  // namespace pecs::events
