// pecs convert: an event file in another format, whole or in part.
#include <fmt/format.h>

#include "commands.h"
#include "console.h"
#include "help.h"
#include "pecs/error.h"
#include "pecs/events/format.h"
#include "pecs/events/select.h"
#include "pecs/events/summary.h"
#include "pecs/progress.h"
#include "pecs/sensor/dropped_file.h"
#include "read_arguments.h"
#include "stage_arguments.h"
#include "units.h"

namespace pecs::app {
namespace {

struct ConvertArguments {
  std::string in, out;
  std::optional<std::string> format, input_format, topic;
  events::ReadOptions read;
  events::Selection selection;
  sensor::StageOptions stages;
  std::optional<std::filesystem::path> dropped;
  bool json = false;
};

// The stages of a chip on the events of a file; counts and writes what they drop of the part that is kept.
class Stages {
 public:
  Stages(const ConvertArguments& o, const events::StreamInfo& info) : is_on_(o.stages.any()) {
    if (is_on_) stages_.emplace(o.stages, info.width, info.height);
    if (o.dropped) file_.emplace(*o.dropped, o.stages);
  }
  // Leaves in `block` what the selector takes.
  void apply(std::vector<events::Event>& block, bool last, events::Selector& selector) {
    if (is_on_) {
      sensor::LabelledEvents part{{block.begin(), block.end()}, {}};
      std::vector<sensor::DroppedEvent> dropped;
      stages_->before_readout(part, &dropped);
      stages_->after_readout(part, last, &dropped);
      std::erase_if(dropped, [&](const auto& d) { return !selector.keeps(d.event); });
      for (const sensor::DroppedEvent& d : dropped) ++counts_[static_cast<std::size_t>(d.stage)];
      if (file_) dropped_.insert(dropped_.end(), dropped.begin(), dropped.end());
      block.assign(part.events.begin(), part.events.end());
    }
    selector.apply(block);
    if (!file_ || (!selector.has_zero() && !last)) return;
    for (sensor::DroppedEvent& d : dropped_) d.event = selector.written(d.event);
    file_->write(dropped_);
    dropped_.clear();
  }
  Json close() {
    if (file_) file_->commit();
    return is_on_ ? sensor::counts_to_json(counts_) : Json();
  }

 private:
  bool is_on_;
  std::optional<sensor::EventStages> stages_;
  std::optional<sensor::DroppedFile> file_;
  std::vector<sensor::DroppedEvent> dropped_;  // not written yet: without an event that is kept, --rezero has no zero
  sensor::StageCounts counts_{};
};

// Some files state no size: then all events are read to measure it.
events::StreamInfo input_info(const ConvertArguments& o, const events::Codec& codec) {
  auto reader = events::open_reader(codec, o.in, o.read);
  events::StreamInfo info = reader->info();
  if (info.width == 0) {
    std::vector<events::Event> block(1 << 16);
    while (reader->read(block) > 0) {
    }
    info = reader->info();
  }
  return info;
}

// Which of the two files are ROS bags. pecs.ros reads and writes them; it runs this command on a file of events.
struct Bags {
  bool in, out;
};

Bags bags_of(const ConvertArguments& o) {
  const std::string end = std::filesystem::path(o.out).extension().string();
  const Bags bags{events::is_ros_bag(o.in), end == ".bag" || end == ".mcap" || o.out.ends_with('/') ||
                                                (o.format && o.format->ends_with("_msgs"))};
  if (o.topic && !bags.in && !bags.out)
    throw Error(ExitCode::usage, fmt::format("{}, {}: --topic: got no ROS bag, wanted one", o.in, o.out));
  return bags;
}

[[noreturn]] void convert_bag(const ConvertArguments& o, Bags bags, const Console& console) {
  std::vector<std::string> words = {"pecs._convert_bag"};
  if (bags.in) words.emplace_back("--from-bag");
  if (bags.out) words.emplace_back("--to-bag");
  if (o.topic) words.push_back("--topic=" + *o.topic);
  if (o.format) words.push_back("--format=" + *o.format);
  words.insert(words.end(), {"--", o.in, o.out});
  words.insert(words.end(), console.arguments().begin(), console.arguments().end());
  become_python("convert", std::move(words));
}

void convert(const ConvertArguments& o, Console& console) {
  const events::Codec& from = events::codec_of_file(o.in, o.input_format);
  const events::Codec& to = events::codec_for_output(o.out, o.format);
  events::Selector selector(o.selection);
  const events::StreamInfo whole = input_info(o, from), info = selector.info(whole);
  const auto reader = events::open_reader(from, o.in, o.read);
  const auto writer = to.open_writer(o.out, info);

  Stages stages(o, whole);
  events::Summary read, written;
  Progress progress("events", 0, console.quiet());
  std::vector<events::Event> block;
  for (bool last = false; !last;) {
    block.resize(1 << 16);
    block.resize(reader->read(block));
    last = block.empty();
    read.add(block);
    stages.apply(block, last, selector);
    written.add(block);
    if (written.time_reversals > 0)
      throw events::non_monotonic_timestamps(o.in, from, o.read,
                                             [&](const events::Event& e) { return selector.keeps(e); });
    writer->write(block);
    progress.at(read.events);
  }
  writer->close();
  if (read.events > 0 && written.events == 0) console.warn(o.in + ": no event lies in the part that was asked for");

  Json results = written.json(info.width, info.height);
  results["events_read"] = read.events;
  results["width"] = info.width;
  results["height"] = info.height;
  results["format"] = to.name;
  using Late = events::ReadOptions::Late;
  const bool sorts = o.read.late == Late::sort;
  if (o.read.late != Late::keep) results[sorts ? "late_events_sorted" : "late_events_dropped"] = reader->late();
  if (const Json counts = stages.close(); !counts.is_null()) results["dropped_by_stage"] = counts;
  const events::Selection& s = o.selection;
  console.record(o.out, {.command = "convert",
                         .config = {{"input_format", from.name},
                                    {"format", to.name},
                                    {"t_start_us", or_null(s.t_start_us)},
                                    {"t_end_us", or_null(s.t_end_us)},
                                    {"stages", sensor::stages_to_json(o.stages)},
                                    {"time_unit", o.read.time_unit ? Json(name_of(*o.read.time_unit)) : Json()},
                                    {"late", o.read.late == Late::keep ? Json() : Json(sorts ? "sort" : "drop")},
                                    {"rezero", s.rezero},
                                    {"decimate", s.decimate}},
                         .inputs = {o.in},
                         .results = results});
  if (o.json) return print_json(results);
  fmt::print(
      "{}: {} of {} events, {}x{} pixels, {}{}\n", o.out, written.events, read.events, info.width, info.height, to.name,
      o.read.late == Late::keep ? "" : fmt::format(", {} late ones {}", reader->late(), sorts ? "sorted" : "dropped"));
}

}  // namespace

void add_convert(CLI::App& app, Console& console) {
  const auto o = std::make_shared<ConvertArguments>();
  CLI::App* sub = app.add_subcommand("convert", "convert an event file to another format, whole, in part or filtered");
  sub->add_option("IN", o->in, "event file or ROS bag")->required();
  add_output(*sub, "OUT", o->out,
             "event file to write; its extension selects the format, .bag, .mcap or FOLDER/ a ROS bag")
      ->required();
  std::string names;
  for (const events::Codec& c : events::codecs())
    if (c.open_writer) names += fmt::format("\n{} ({}): {}", c.name, c.extensions.front(), c.description);
  names += "\nof a ROS bag: dvs_msgs (default of .bag) or event_camera_msgs";
  sub->add_option("--format", o->format, "format of OUT, one of:" + names);
  sub->add_option("--topic", o->topic, "topic of the events in the ROS bag IN, otherwise in OUT");
  sub->add_option("--input-format", o->input_format, "format of IN, if it cannot be detected");
  add_quantity(*sub, "--t-start", o->selection.t_start_us, "us", "keep events from this time of IN on");
  add_quantity(*sub, "--t-end", o->selection.t_end_us, "us", "keep events before this time of IN");
  sub->add_flag("--rezero", o->selection.rezero, "subtract the time of the first event kept");
  sub->add_option("--decimate", o->selection.decimate,
                  "keep every N-th pixel each way (x % N == N / 2) and divide coordinates by N: the same pixels on a "
                  "coarser grid")
      ->check(CLI::Range(1, 1024));
  add_read_options(*sub, o->read);
  sub->add_option_function<std::string>(
         "--late",
         [&read = o->read](const std::string& what) {
           read.late = what == "sort" ? events::ReadOptions::Late::sort : events::ReadOptions::Late::drop;
         },
         "events of IN that are earlier than one before them: sort (in memory) or drop (default: an error)")
      ->check(CLI::IsMember({"sort", "drop"}));
  add_stages(*sub, o->stages, o->dropped);
  sub->add_flag("--json", o->json, "machine-readable output");
  add_examples(*sub,
               {"pecs convert events.raw events.h5", "pecs convert events.raw part.csv --t-start 20ms --t-end 40ms",
                "pecs convert events.txt events.npz --input-format e2vid",
                "pecs convert events.raw steady.raw --afk 90:110 --dropped flicker.npy",
                "pecs convert recording.bag events.raw --rezero --topic /dvs/events"});
  sub->callback([o, &console] {
    const Bags bags = bags_of(*o);
    bags.in || bags.out ? convert_bag(*o, bags, console) : convert(*o, console);
  });
}

}  // namespace pecs::app
