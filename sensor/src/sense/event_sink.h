#pragma once
// The end of the pipeline: readout, the output's window, the files.
#include <memory>
#include <optional>
#include <vector>

#include "pecs/events/format.h"
#include "pecs/files.h"
#include "pecs/sensor/dropped_file.h"
#include "pecs/sensor/readout.h"
#include "pecs/sensor/sense.h"
#include "sense/frame_folder.h"

namespace pecs::sensor {

class EventSink {
 public:
  EventSink(const SenseOptions& options, const Chip& chip, const Timeline& timeline);
  // Takes events, sorted across calls, and empties `fired`. `last`: none follow. False: options.watch ends the output.
  bool write(LabelledEvents& fired, bool last);
  // Those that lie before the next events of write().
  void write(std::vector<events::Frame> frames);
  // Completes the files.
  void close();
  Json report() const;                             // counts and rates
  std::int64_t unsure() const { return unsure_; }  // events of the output

 private:
  void read_out(LabelledEvents& part, bool last);
  bool send(LabelledEvents& labelled);
  void note_dropped();

  const SenseOptions& options_;
  const Timeline& timeline_;
  std::unique_ptr<events::Writer> writer_;
  std::optional<Readout> readout_;
  EventStages stages_;
  LabelledEvents sent_;
  std::vector<DroppedEvent> dropped_;
  StageCounts dropped_by_{};  // in the output's window
  std::int64_t lost_ = 0;     // by the readout, in the output's window
  std::optional<NpyFile> causes_;
  std::optional<DroppedFile> dropped_file_;
  std::optional<FrameFolder> frame_folder_;
  std::int64_t events_ = 0, on_ = 0, unsure_ = 0, first_us_ = 0, last_us_ = 0;
};

}  // namespace pecs::sensor
