#pragma once
// NumPy files that are written during a run: columns of bytes, and the events that a stage dropped.
#include <cstddef>
#include <filesystem>
#include <span>
#include <string>

#include "pecs/files.h"
#include "pecs/sensor/stages.h"

namespace pecs::sensor {

// One array of records. commit() puts the final length into its header.
class NpyFile {
 public:
  // descr: NumPy's description of a record, with its quotes or brackets.
  NpyFile(const std::filesystem::path& path, std::string descr);
  void write(std::span<const std::byte> bytes, std::size_t records);
  void commit();

 private:
  void write_header();

  AtomicFile file_;
  std::string descr_;
  std::size_t count_ = 0;
};

// Records t, x, y, p and stage (the numbers of Stage) of what a stage after the readout dropped.
class DroppedFile {
 public:
  // Throws usage if no stage drops events.
  DroppedFile(const std::filesystem::path& path, const StageOptions& stages);
  void write(std::span<const DroppedEvent> dropped);
  void commit() { file_.commit(); }

 private:
  NpyFile file_;
};

}  // namespace pecs::sensor
