#include <cstddef>

#include "guard.h"
#include "pecs/events/format.h"
#include "pecs/strict_json.h"

using namespace pecs;
using pecs::capi::given;
using pecs::capi::guard;

struct pecs_event_reader {
  const events::Codec* codec;
  std::unique_ptr<events::Reader> reader;
  bool counts_late = false;
};
struct pecs_event_writer {
  std::unique_ptr<events::Writer> writer;
};

static_assert(sizeof(pecs_event) == sizeof(events::Event) &&
              offsetof(pecs_event, t_us) == offsetof(events::Event, t_us) &&
              offsetof(pecs_event, x) == offsetof(events::Event, x) &&
              offsetof(pecs_event, y) == offsetof(events::Event, y) &&
              offsetof(pecs_event, p) == offsetof(events::Event, p));

extern "C" {

char* pecs_event_formats(pecs_error* error) {
  return guard(error, [] {
    Json list = Json::array();
    for (const events::Codec& c : events::codecs())
      list.push_back({{"name", c.name},
                      {"description", c.description},
                      {"extensions", c.extensions},
                      {"reads", bool(c.open_reader)},
                      {"writes", bool(c.open_writer)}});
    return capi::hand_over(list);
  });
}

pecs_event_reader* pecs_event_reader_open(const char* path, const char* options_json, pecs_error* error) {
  return guard(error, [&] {
    const Json json = capi::options_from(options_json);
    JsonObject o(json, "options");
    events::ReadOptions read;
    const std::optional<std::string> format = o.has("format") ? std::optional(o.text("format")) : std::nullopt;
    if (o.has("time_unit")) read.time_unit = time_unit_from(o.text("time_unit"));
    if (o.has("width") || o.has("height")) {
      read.width = static_cast<int>(o.integer("width", 1, 65536));
      read.height = static_cast<int>(o.integer("height", 1, 65536));
    }
    using Late = events::ReadOptions::Late;
    if (o.has("late")) read.late = o.one_of("late", {"sort", "drop"}) == "sort" ? Late::sort : Late::drop;
    o.done();
    const events::Codec& codec = events::codec_of_file(&given(path, "path"), format);
    return new pecs_event_reader{&codec, events::open_reader(codec, path, read), read.late != Late::keep};
  });
}

char* pecs_event_reader_info(const pecs_event_reader* reader, pecs_error* error) {
  return guard(error, [&] {
    const events::StreamInfo& info = given(reader, "reader").reader->info();
    Json json = {
        {"format", reader->codec->name}, {"width", info.width}, {"height", info.height}, {"camera", info.camera}};
    if (reader->counts_late) json["late_events"] = reader->reader->late();
    return capi::hand_over(json);
  });
}

int64_t pecs_event_reader_read(pecs_event_reader* reader, pecs_event* out, int64_t capacity, pecs_error* error) {
  return guard(error, [&] {
    if (capacity < 1) throw Error(ExitCode::usage, fmt::format("capacity: got {}, wanted at least 1", capacity));
    const std::span buffer(reinterpret_cast<events::Event*>(&given(out, "out")), static_cast<std::size_t>(capacity));
    return static_cast<std::int64_t>(given(reader, "reader").reader->read(buffer));
  });
}

void pecs_event_reader_close(pecs_event_reader* reader) { delete reader; }

pecs_event_writer* pecs_event_writer_create(const char* path, const char* options_json, pecs_error* error) {
  return guard(error, [&] {
    const Json json = capi::options_from(options_json);
    JsonObject options(json, "options");
    events::StreamInfo info;
    info.width = static_cast<int>(options.integer_or("width", 0, 0, 65536));
    info.height = static_cast<int>(options.integer_or("height", 0, 0, 65536));
    info.camera = options.text_or("camera", "");
    const std::string format = options.text_or("format", "");
    options.done();
    return new pecs_event_writer{
        events::open_writer(&given(path, "path"), info, format.empty() ? std::optional<std::string>() : format)};
  });
}

int pecs_event_writer_write(pecs_event_writer* writer, const pecs_event* list, int64_t count, pecs_error* error) {
  return guard(error, [&] {
    events::Writer& out = *given(writer, "writer").writer;
    capi::check_count(count);
    if (count)
      out.write({reinterpret_cast<const events::Event*>(&given(list, "events")), static_cast<std::size_t>(count)});
    return 0;
  });
}

int pecs_event_writer_finish(pecs_event_writer* writer, pecs_error* error) {
  return guard(error, [&] {
    given(writer, "writer").writer->close();
    return 0;
  });
}

void pecs_event_writer_close(pecs_event_writer* writer) { delete writer; }

}  // extern "C"
