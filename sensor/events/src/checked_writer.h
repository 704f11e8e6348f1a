#pragma once
// Checks common to all writers: decreasing timestamps, pixels outside the sensor, polarities other than 0 and 1, use
// after close().
#include <string>

#include "pecs/events/format.h"

namespace pecs::events {

class CheckedWriter : public Writer {
 public:
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

}  // namespace pecs::events
