#pragma once
// Event files: one Reader and one Writer interface, one source file per format.
//
// To add a format:
//   1. write src/<format>.cpp with a `Codec make_<format>()` that fills the struct below (readers derive from
//      EventReader in src/codec.h, writers from CheckedWriter in src/checked_writer.h);
//   2. declare it and add it to the list in src/registry.cpp, and add the file to CMakeLists.txt;
//   3. add a reader from another project to PEERS in tests/python/support/event_readers.py, and a line to
//      tests/fuzz/CMakeLists.txt; the property suite (tests/events) covers the registry;
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
#include "pecs/time_unit.h"

namespace pecs::events {

struct StreamInfo {
  int width = 0;  // pixels; if the file has no size, 0 until all events are read, then the extent of the events
  int height = 0;
  std::string camera;  // e.g. "IMX636"; empty when unknown
  // Frames in the file of the events; of a reader, those so far, and of a writer, whether any will come.
  std::int64_t frames = 0;
};

// A picture that the same pixels took, on the events' clock.
struct Frame {
  std::int64_t begin_us = 0, end_us = 0;  // of the exposure of the middle row
  int bits = 8;
  std::vector<std::uint16_t> values;  // below 2^bits, row by row
};

// Properties that the user states of a file that does not.
struct ReadOptions {
  std::optional<TimeUnit> time_unit;                       // of Codec::takes_time_unit; else an error
  int width = 0, height = 0;                               // 0: not stated
  enum class Late { keep, sort, drop } late = Late::keep;  // events earlier than one before them
};

// Reads events in file order. Throws pecs::Error (bad_input with file and byte offset) on damage; events read before it
// are valid. Readers do not check the order of timestamps; writers and `pecs info` do.
class Reader {
 public:
  virtual ~Reader() = default;
  virtual const StreamInfo& info() const = 0;
  // Reads at most out.size() events and returns their number; 0 only at the end.
  virtual std::size_t read(std::span<Event> out) = 0;
  // End of the last event read, for errors ("byte 123"); empty if the format has no byte offsets.
  virtual std::string place() const { return {}; }
  // Number of events so far that ReadOptions::late moved or dropped.
  virtual std::uint64_t late() const { return 0; }
};

// Writes events sorted by t_us, inside width x height, with p of 0 or 1 (throws bad_input otherwise). close() renames
// the file to its final name; without it, <name>.partial remains.
class Writer {
 public:
  virtual ~Writer() = default;
  virtual void write(std::span<const Event> events) = 0;
  // Only of a codec that holds frames, before the events that follow the exposure.
  virtual void write(Frame frame);
  virtual void close() = 0;
};

// Limits of a format; the property suite generates its streams within them.
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
  std::vector<std::string> extensions;  // ".raw", …; the first one is the default
  // True if the file's first bytes match this format (extension as a hint only). Does not throw.
  std::function<bool(const std::filesystem::path&, std::span<const std::byte> head)> sniff;
  std::function<std::unique_ptr<Reader>(const std::filesystem::path&, const ReadOptions&)> open_reader;  // or empty
  std::function<std::unique_ptr<Writer>(const std::filesystem::path&, const StreamInfo&)> open_writer;   // or empty
  Limits limits;
  // Files of this format may lack the unit of time. Readers then assume one, and refuse times that
  // contradict it.
  bool takes_time_unit = false;
  bool holds_frames = false;
};

const std::vector<Codec>& codecs();

// Whether the content is a ROS bag's: of ROS 1, MCAP, SQLite, or a folder with metadata.yaml. Python reads it
// (pecs.ros).
bool is_ros_bag(const std::filesystem::path& path);

// The codec of an existing file, by content, then by extension; `format` overrides both. Throws pecs::Error.
const Codec& codec_of_file(const std::filesystem::path& path, const std::optional<std::string>& format = {});
// The codec for a new file, by extension; `format` overrides it. Throws pecs::Error.
const Codec& codec_for_output(const std::filesystem::path& path, const std::optional<std::string>& format = {});

std::unique_ptr<Reader> open_reader(const Codec& codec, const std::filesystem::path& path,
                                    const ReadOptions& options = {});
std::unique_ptr<Reader> open_reader(const std::filesystem::path& path, const std::optional<std::string>& format = {},
                                    const ReadOptions& options = {});
std::unique_ptr<Writer> open_writer(const std::filesystem::path& path, const StreamInfo& info,
                                    const std::optional<std::string>& format = {});

// Error for decreasing timestamps: names the first event, among those that `keep` accepts, that is earlier than its
// predecessor. Reads the file again.
Error non_monotonic_timestamps(const std::filesystem::path& path, const Codec& codec, const ReadOptions& options,
                               const std::function<bool(const Event&)>& keep);

struct Stream {
  StreamInfo info;
  std::vector<Event> events;
};
Stream read_all(const std::filesystem::path& path, const std::optional<std::string>& format = {});
// Holds only the events in [0, to_us), relative to the file's least time or, with `absolute`, to t = 0.
Stream read_part(const std::filesystem::path& path, std::int64_t to_us, bool absolute = false);

}  // namespace pecs::events
