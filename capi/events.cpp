#include <cstddef>

#include "guard.h"
#include "pecs/events/format.h"
#include "pecs/strict_json.h"

using namespace pecs;
using pecs::capi::guard;

struct pecs_event_reader {
  const events::Codec* codec;
  std::unique_ptr<events::Reader> reader;
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
  return guard(error, static_cast<char*>(nullptr), [] {
    Json list = Json::array();
    for (const events::Codec& c : events::codecs())
      list.push_back({{"name", c.name},
                      {"description", c.description},
                      {"extensions", c.extensions},
                      {"reads", bool(c.open_reader)},
                      {"writes", bool(c.open_writer)}});
    return capi::hand_over(list.dump());
  });
}

pecs_event_reader* pecs_events_open(const char* path, const char* format, pecs_error* error) {
  return guard(error, static_cast<pecs_event_reader*>(nullptr), [&] {
    const events::Codec& codec =
        events::codec_of_file(path, format ? std::optional<std::string>(format) : std::optional<std::string>());
    return new pecs_event_reader{&codec, codec.open_reader(path)};
  });
}

char* pecs_events_info(const pecs_event_reader* reader, pecs_error* error) {
  return guard(error, static_cast<char*>(nullptr), [&] {
    const events::StreamInfo& info = reader->reader->info();
    const Json json = {
        {"format", reader->codec->name}, {"width", info.width}, {"height", info.height}, {"camera", info.camera}};
    return capi::hand_over(json.dump());
  });
}

int64_t pecs_events_read(pecs_event_reader* reader, pecs_event* out, int64_t capacity, pecs_error* error) {
  return guard(error, std::int64_t{-1}, [&] {
    const std::span buffer(reinterpret_cast<events::Event*>(out), static_cast<std::size_t>(capacity));
    return static_cast<std::int64_t>(reader->reader->read(buffer));
  });
}

void pecs_events_close(pecs_event_reader* reader) { delete reader; }

pecs_event_writer* pecs_events_create(const char* path, const char* options_json, pecs_error* error) {
  return guard(error, static_cast<pecs_event_writer*>(nullptr), [&] {
    const Json json = parse_json(options_json, "options");
    JsonObject options(json, "options");
    events::StreamInfo info;
    info.width = static_cast<int>(options.integer_or("width", 0, 0, 65536));
    info.height = static_cast<int>(options.integer_or("height", 0, 0, 65536));
    info.camera = options.text_or("camera", "");
    const std::string format = options.text_or("format", "");
    options.done();
    return new pecs_event_writer{
        events::open_writer(path, info, format.empty() ? std::optional<std::string>() : format)};
  });
}

int pecs_events_write(pecs_event_writer* writer, const pecs_event* list, int64_t count, pecs_error* error) {
  return guard(error, 1, [&] {
    writer->writer->write({reinterpret_cast<const events::Event*>(list), static_cast<std::size_t>(count)});
    return 0;
  });
}

int pecs_events_finish(pecs_event_writer* writer, pecs_error* error) {
  return guard(error, 1, [&] {
    writer->writer->close();
    return 0;
  });
}

void pecs_events_discard(pecs_event_writer* writer) { delete writer; }

}  // extern "C"
