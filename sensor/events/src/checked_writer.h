#pragma once
// Checks common to all writers: decreasing timestamps, pixels outside the sensor, polarities other than 0 and 1, use
// after close(). RunWriter: what a format encodes together does not depend on the blocks of write().
#include <string>
#include <vector>

#include "pecs/events/format.h"

namespace pecs::events {

class CheckedWriter : public Writer {
 public:
  using Writer::write;
  // Throws bad_output when the format cannot hold the size; with `needs_size`, also when none is given.
  CheckedWriter(std::filesystem::path path, StreamInfo info, const Limits& limits, bool needs_size = true);
  void write(std::span<const Event> events) final;
  void close() final;

 protected:
  virtual void put(std::span<const Event> events) = 0;  // checked, never empty
  virtual void finish() = 0;                            // completes the file and renames it to its final name
  const std::filesystem::path& path() const { return path_; }
  const StreamInfo& info() const { return info_; }
  std::uint64_t count() const { return count_; }  // of events before the current put()

 private:
  std::filesystem::path path_;
  StreamInfo info_;
  Limits limits_;
  std::uint64_t count_ = 0;
  std::int64_t last_t_us_;
  bool closed_ = false;
};

class RunWriter : public CheckedWriter {
 public:
  using CheckedWriter::CheckedWriter;

 protected:
  // Number of events, from the first on, that may be encoded together.
  virtual std::size_t run(std::span<const Event> events) const = 0;
  // Encodes a run, or its first events; returns their number.
  virtual std::size_t put_run(std::span<const Event> events) = 0;
  virtual void finish_file() = 0;

 private:
  void put(std::span<const Event> events) override;
  void finish() override;
  void put_runs(bool last);

  std::vector<Event> rest_;  // begins with the run that the next block may continue
};

}  // namespace pecs::events
