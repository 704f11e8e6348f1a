#pragma once
// Event files: one Reader and one Writer interface, one source file per format.
//
// To add a format:
//   1. write src/<format>.cpp with a `Codec make_<format>()` that fills the struct below (writers derive from
//      CheckedWriter in src/checked_writer.h);
//   2. add it to the list in src/registry.cpp and to CMakeLists.txt;
//   3. name a reader that is not ours in tests/python/events/test_formats.py: the property suite (tests/events) runs over the
//      registry by itself;
//   4. describe the layout in docs/reference/event_file.md.
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "pecs/error.h"
#include "pecs/events/event.h"

namespace pecs::events {

struct StreamInfo {
  int width = 0;  // pixels; a file without a size gives 0 until its reader has seen all events, then what they span
  int height = 0;
  std::string camera;  // e.g. "IMX636"; empty when unknown
};

// Pulls events in file order. Throws pecs::Error (bad_input with file and byte offset) on damage; what was read before
// is good. Times are not checked for order here: that is the writers' and `pecs info`'s.
class Reader {
 public:
  virtual ~Reader() = default;
  virtual const StreamInfo& info() const = 0;
  // Fills at most out.size() events, returns how many; 0 only at the end.
  virtual std::size_t read(std::span<Event> out) = 0;
  // Where the event last read ends, as in errors ("byte 123"); empty when the format has no such place.
  virtual std::string place() const { return {}; }
};

// Takes events sorted by t_us, inside width x height, with p of 0 or 1 (throws bad_input otherwise). The file appears
// under its name at close() only; destroyed before that, it stays as <name>.partial.
class Writer {
 public:
  virtual ~Writer() = default;
  virtual void write(std::span<const Event> events) = 0;
  virtual void close() = 0;
};

// What a format can hold; the property suite builds its streams from this.
struct Limits {
  std::int64_t t_min_us = INT64_MIN;
  std::int64_t t_max_us = INT64_MAX;
  std::int64_t max_gap_us = INT64_MAX;  // from one event to the next, and from 0 to the first
  int max_size = 65536;                 // width and height
  bool keeps_size = true;
};

struct Codec {
  std::string name;                     // "evt3", as for --format
  std::string description;              // one line for --help
  std::vector<std::string> extensions;  // ".raw", …; the first one is the usual one
  // True if the file's first bytes are of this format (extension as a hint only). Never throws.
  std::function<bool(const std::filesystem::path&, std::span<const std::byte> head)> sniff;
  std::function<std::unique_ptr<Reader>(const std::filesystem::path&)> open_reader;                     // or empty
  std::function<std::unique_ptr<Writer>(const std::filesystem::path&, const StreamInfo&)> open_writer;  // or empty
  Limits limits;
};

const std::vector<Codec>& codecs();

// The codec of an existing file: from the content, else from the extension; `format` overrides. Throws pecs::Error.
const Codec& codec_of_file(const std::filesystem::path& path, const std::optional<std::string>& format = {});
// The codec for a new file: from the extension; `format` overrides. Throws pecs::Error.
const Codec& codec_for_output(const std::filesystem::path& path, const std::optional<std::string>& format = {});

std::unique_ptr<Reader> open_reader(const std::filesystem::path& path, const std::optional<std::string>& format = {});
std::unique_ptr<Writer> open_writer(const std::filesystem::path& path, const StreamInfo& info,
                                    const std::optional<std::string>& format = {});

// The error for a file whose times fall: names the first event, of those that `keep` keeps, that is earlier than the
// kept one before it. Reads the file again.
Error time_falls(const std::filesystem::path& path, const Codec& codec, const std::function<bool(const Event&)>& keep);

struct Stream {
  StreamInfo info;
  std::vector<Event> events;
};
Stream read_all(const std::filesystem::path& path, const std::optional<std::string>& format = {});
// The same without holding more than the events of [from_us, to_us), counted from the file's first event or, with
// `absolute`, from t = 0.
Stream read_part(const std::filesystem::path& path, std::int64_t from_us, std::int64_t to_us, bool absolute = false);

}  // namespace pecs::events
