// pecs info: what an event file holds.
#include <fmt/format.h>

#include "commands.h"
#include "pecs/events/format.h"
#include "pecs/events/summary.h"

namespace pecs::app {
namespace {

Json event_file_info(const std::string& path, const std::optional<std::string>& format) {
  const events::Codec& codec = events::codec_of_file(path, format);
  const auto reader = codec.open_reader(path);
  events::Summary summary;
  std::vector<events::Event> block(1 << 16);
  while (const std::size_t n = reader->read(block)) summary.add(std::span(block).first(n));
  const events::StreamInfo& info = reader->info();
  Json out = summary.json(info.width, info.height);
  out["format"] = codec.name;
  out["width"] = info.width;
  out["height"] = info.height;
  out["camera"] = info.camera;
  return out;
}

void print(const std::string& path, const Json& info) {
  fmt::print("{}: {}, {}x{} pixels{}\n", path, info["format"].get<std::string>(), info["width"].get<int>(),
             info["height"].get<int>(), info["camera"] == "" ? "" : ", " + info["camera"].get<std::string>());
  fmt::print("events       {}\n", info["events"].get<std::uint64_t>());
  if (info["t_first_us"].is_null()) return;
  fmt::print("time         {} to {} us, {:.6f} s\n", info["t_first_us"].get<std::int64_t>(),
             info["t_last_us"].get<std::int64_t>(), info["duration_us"].get<double>() * 1e-6);
  fmt::print("ON fraction  {:.4f}\n", info["on_fraction"].get<double>());
  if (!info["event_rate_hz"].is_null())
    fmt::print("mean rate    {:.4g} events/s\n", info["event_rate_hz"].get<double>());
  if (!info["event_rate_per_pixel_hz"].is_null())
    fmt::print("             {:.4g} events/s per pixel\n", info["event_rate_per_pixel_hz"].get<double>());
  if (const auto n = info["time_reversals"].get<std::uint64_t>(); n > 0) fmt::print("time goes back {} times\n", n);
}

}  // namespace

void add_info(CLI::App& app) {
  struct Options {
    std::string path;
    std::optional<std::string> format;
    bool json = false;
  };
  const auto o = std::make_shared<Options>();
  CLI::App* sub = app.add_subcommand("info", "what an event file holds: events, size, times (us), rates");
  sub->add_option("FILE", o->path, "event file")->required();
  sub->add_option("--format", o->format, "of FILE, when its content does not say");
  sub->add_flag("--json", o->json, "machine output");
  sub->callback([o] {
    const Json info = event_file_info(o->path, o->format);
    if (o->json)
      fmt::print("{}\n", info.dump());
    else
      print(o->path, info);
  });
}

}  // namespace pecs::app
