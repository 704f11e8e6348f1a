// A whole stack through `pecs sense`: frames, motion, pictures between frames, a loop, whatever their values are. Its
// events are sorted and inside the picture, and the same with two threads.
#include "pecs/sensor/sense.h"

#include "check_events.h"
#include "fuzz.h"
#include "stacks.h"

namespace {

using namespace pecs;

Json channels() {
  Json names;
  for (const char* side : {"", "back_"})
    for (const char* name : {"x_q1", "y_q1", "x_mid", "y_mid", "x_q3", "y_q3", "x_end", "y_end", "z", "z_end"})
      names.push_back(std::string(side) + name);
  return names;
}

void write_stack(fuzz::Bytes& in, const std::string& folder, std::uint8_t kind) {
  const bool moves = kind & 1, has_between = kind & 2, loops = kind & 4, fine = kind & 8;
  Json json = fuzz::stack_json();
  json["width"] = 1 + in.take<std::uint8_t>() % 24;
  json["height"] = 1 + in.take<std::uint8_t>() % 6;
  json["times_ns"] = Json::array();
  std::int64_t t_ns = 0;
  for (int i = 2 + in.take<std::uint8_t>() % 3; i > 0; --i) {
    json["times_ns"].push_back(t_ns);
    t_ns += 20'000 + in.take<std::uint32_t>() % 4'000'000;
  }
  json["period_ns"] = loops ? Json(t_ns) : Json();
  if (fine) json["subpixels"] = 2;
  if (has_between) json["between"] = true;
  if (moves)
    json["layers"] = {{{"name", "motion"},
                       {"files", "motion_%06d.exr"},
                       {"channels", channels()},
                       {"unit", "px"},
                       {"at", "interval"}}};

  const sensor::StackWriter writer(folder, json);
  const sensor::StackInfo& info = writer.info();
  const auto values = [&](const sensor::Layer& layer) { return fuzz::strange_floats(in, frame_values(info, layer)); };
  const sensor::Layer& light = info.layers[0];
  for (std::int64_t i = 0; i < planned_frames(info, light); ++i) {
    std::vector<float> frame = values(light);
    for (float& v : frame) v *= 1e-3f;
    writer.write_frame(i, frame);
  }
  for (std::int64_t i = 0; moves && i < planned_frames(info, info.layers[1]); ++i) {
    writer.write_frame(i, values(info.layers[1]), sensor::kMotion);
    const auto [begin_ns, end_ns] = interval_ns(info, i, folder);
    if (has_between) writer.write_between(i, 1, begin_ns + (end_ns - begin_ns) / 3, values(light));
  }
}

std::vector<events::Event> events_of(const std::string& folder, std::uint8_t kind, int threads) {
  sensor::SenseOptions options;
  options.stack = folder;
  options.output = folder + "/events.raw";
  options.chip = kind & 16 ? "imx636" : "ideal";
  options.no_noise = kind & 32;
  options.threads = threads;
  options.quiet = true;
  if (kind & 4) options.window = {.warmup_loops = kind & 64 ? 1 : 0, .start_us = 300, .duration_us = 6000};
  std::vector<events::Event> out;
  options.watch = [&](std::span<const events::Event> events) {
    out.insert(out.end(), events.begin(), events.end());
    return true;
  };
  sensor::sense(options);
  return out;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::try_to([&] {
    const fuzz::MemoryFolder folder;
    fuzz::Bytes in(fuzz::text(data, size));
    const auto kind = in.take<std::uint8_t>();
    write_stack(in, folder.path(), kind);
    const std::vector<events::Event> events = events_of(folder.path(), kind, 1);
    const sensor::StackReader reader(folder.path());
    fuzz::check(events, reader.info().width, reader.info().height);
    if (events != events_of(folder.path(), kind, 2)) fuzz::defect("other events with two threads");
  });
  return 0;
}
