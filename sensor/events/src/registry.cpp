#include <fmt/format.h>

#include <algorithm>

#include "codec.h"
#include "input_file.h"
#include "pecs/error.h"
#include "pecs/events/format.h"
#include "pecs/text.h"
#include "raw_header.h"
#include "stated.h"

namespace pecs::events {

Codec make_evt3(), make_evt2(), make_evt21(), make_dat(), make_metavision_hdf5(), make_dsec_hdf5(), make_aedat4(),
    make_aedat2(), make_npz(), make_csv(), make_e2vid(), make_v2e();

namespace {

std::string names(bool for_output) {
  std::string out;
  for (const Codec& c : codecs())
    if (for_output ? bool(c.open_writer) : bool(c.open_reader)) out += (out.empty() ? "" : ", ") + c.name;
  return out;
}

const Codec* by_name(const std::string& name) {
  const auto& all = codecs();
  const auto it = std::ranges::find(all, name, &Codec::name);
  return it == all.end() ? nullptr : &*it;
}

bool has_extension(const Codec& codec, const std::filesystem::path& path) {
  return std::ranges::find(codec.extensions, lower(path.extension().string())) != codec.extensions.end();
}

const Codec& named(const std::filesystem::path& path, const std::string& name, bool for_output) {
  const Codec* codec = by_name(name);
  if (!codec || !(for_output ? bool(codec->open_writer) : bool(codec->open_reader)))
    throw bad_usage(path.string() + ": format", name, "one of " + names(for_output));
  return *codec;
}

}  // namespace

const std::vector<Codec>& codecs() {
  static const std::vector<Codec> all = {
      make_evt3(),   make_evt2(),   make_evt21(), make_dat(), make_metavision_hdf5(), make_dsec_hdf5(),
      make_aedat4(), make_aedat2(), make_npz(),   make_csv(), make_e2vid(),           make_v2e()};
  return all;
}

bool is_ros_bag(const std::filesystem::path& path) {
  std::error_code unreadable;  // the reader reports it
  if (std::filesystem::is_directory(path, unreadable))
    return std::filesystem::exists(path / "metadata.yaml", unreadable);
  if (!std::filesystem::is_regular_file(path, unreadable)) return false;
  const std::vector<std::byte> head = head_of(path, 16);
  return begins_with(head, "#ROSBAG V2.0") || begins_with(head, "\x89MCAP0\r\n") ||
         begins_with(head, "SQLite format 3");
}

const Codec& codec_of_file(const std::filesystem::path& path, const std::optional<std::string>& format) {
  if (is_ros_bag(path)) throw bad_input(path.string(), "", "a ROS bag", "an event file (pecs convert IN OUT.raw)");
  if (format) return named(path, *format, false);
  const std::vector<std::byte> head = head_of(path, kHeadBytes);
  for (const Codec& codec : codecs())
    if (codec.open_reader && codec.sniff(path, head)) return codec;
  if (const std::string said = parse_raw_header(head).encoding; !said.empty())
    throw bad_input(path.string(), "format", shortened(said, 40), "EVT2, EVT21 or EVT3");
  if (begins_with(head, "#!AER-DAT")) {
    const std::string_view text(reinterpret_cast<const char*>(head.data()), head.size());
    throw bad_input(path.string(), "byte 0", shortened(text.substr(0, text.find_first_of("\r\n")), 40),
                    "#!AER-DAT2.0 or #!AER-DAT4.0");
  }
  if (lower(path.extension().string()) == ".raw") {
    const std::string encoding = raw_encoding(head);
    if (encoding.empty())
      throw bad_input(path.string(), "format", "a RAW file that does not name its encoding",
                      "--input-format evt2, evt21 or evt3");
    return *by_name(lower(encoding));
  }
  for (const Codec& codec : codecs())
    if (codec.open_reader && has_extension(codec, path)) return codec;
  throw bad_input(path.string(), "byte 0", "content of no known event format", "one of " + names(false));
}

const Codec& codec_for_output(const std::filesystem::path& path, const std::optional<std::string>& format) {
  if (format) return named(path, *format, true);
  for (const Codec& codec : codecs())
    if (codec.open_writer && has_extension(codec, path)) return codec;
  throw Error(ExitCode::usage,
              fmt::format("{}: extension: got {}, wanted one of an event format (or name one: {})", path.string(),
                          path.has_extension() ? path.extension().string() : "none", names(true)));
}

std::unique_ptr<Reader> open_reader(const Codec& codec, const std::filesystem::path& path, const ReadOptions& options) {
  if (options.time_unit && !codec.takes_time_unit)
    throw Error(ExitCode::usage, fmt::format("{}: time_unit: got {}, wanted none: the times of {} are in us",
                                             path.string(), name_of(*options.time_unit), codec.name));
  return as_stated(codec.open_reader(path, options), path, options);
}

std::unique_ptr<Reader> open_reader(const std::filesystem::path& path, const std::optional<std::string>& format,
                                    const ReadOptions& options) {
  return open_reader(codec_of_file(path, format), path, options);
}

std::unique_ptr<Writer> open_writer(const std::filesystem::path& path, const StreamInfo& info,
                                    const std::optional<std::string>& format) {
  return codec_for_output(path, format).open_writer(path, info);
}

Error non_monotonic_timestamps(const std::filesystem::path& path, const Codec& codec, const ReadOptions& options,
                               const std::function<bool(const Event&)>& keep) {
  const std::unique_ptr<Reader> reader = open_reader(codec, path, options);
  Event event;
  std::optional<std::int64_t> last_us;
  for (std::uint64_t i = 0; reader->read(std::span(&event, 1)) > 0; ++i) {
    if (!keep(event)) continue;
    if (last_us && event.t_us < *last_us) {
      const std::string place = reader->place();
      return bad_input(path.string(), fmt::format("event {}{}", i, place.empty() ? "" : " (" + place + ")"),
                       fmt::format("t = {} us", event.t_us),
                       fmt::format("at least {} us, the event before (or --late sort, --late drop)", *last_us));
    }
    last_us = event.t_us;
  }
  return {ExitCode::internal, path.string() + ": timestamps do not decrease"};
}

namespace {

// trim(events, first): discards events of the block that begins at `first`.
template <class Trim>
Stream read_blocks(Reader& reader, const Trim& trim) {
  constexpr std::size_t kBlock = 1 << 16;
  Stream stream;
  std::size_t n = 0;
  do {
    const std::size_t filled = stream.events.size();
    stream.events.resize(filled + kBlock);
    n = reader.read(std::span(stream.events).subspan(filled));
    stream.events.resize(filled + n);
    trim(stream.events, filled);
  } while (n > 0);
  stream.info = reader.info();
  return stream;
}

}  // namespace

Stream read_all(const std::filesystem::path& path, const std::optional<std::string>& format) {
  return read_blocks(*open_reader(path, format), [](std::vector<Event>&, std::size_t) {});
}

Stream read_part(const std::filesystem::path& path, std::int64_t to_us, bool absolute) {
  std::int64_t origin_us = absolute ? 0 : INT64_MAX;
  const auto outside = [&](const Event& e) { return e.t_us < origin_us || e.t_us - origin_us >= to_us; };
  Stream stream = read_blocks(*open_reader(path), [&](std::vector<Event>& events, std::size_t first) {
    const auto added = events.begin() + static_cast<std::ptrdiff_t>(first);
    for (auto e = added; e != events.end() && !absolute; ++e) origin_us = std::min(origin_us, e->t_us);
    events.erase(std::remove_if(added, events.end(), outside), events.end());
  });
  std::erase_if(stream.events, outside);  // a late event has moved the origin
  return stream;
}

}  // namespace pecs::events
