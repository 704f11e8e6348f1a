#pragma once
// The EXR stack (contract 1, docs/exr_stack.md): a folder with stack.json and one spectral OpenEXR file per instant.
// Conventions: row 0 is the top of the picture; times in ns from the start of the stack; bands of rising wavelength.
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "pecs/sensor/bands.h"
#include "pecs/sensor/source.h"
#include "pecs/strict_json.h"

namespace pecs::sensor {

inline constexpr int kMaxBands = 256;

// Checks every key of stack.json; `file` is named in errors.
StackInfo parse_stack_info(const Json& json, const std::string& file);

class StackWriter {
 public:
  // Creates the folder and writes stack.json first, or continues a stack whose stack.json says the same.
  // Throws bad_output naming the key that differs.
  StackWriter(std::filesystem::path folder, const Json& stack_json);
  const StackInfo& info() const { return info_; }
  // True if the frame is whole on disk (its last row can be read and its time is right).
  bool has_frame(std::int64_t index) const;
  // values: [bands][height][width]. The file appears whole or not at all.
  void write_frame(std::int64_t index, std::span<const float> values) const;

 private:
  std::filesystem::path folder_;
  StackInfo info_;
};

class StackReader : public FrameSource {
 public:
  // Reads stack.json; without one, the header of the first EXR file (of any name, in natural order): spectral channels
  // S0.<wavelength>nm (pbrt-v4, Mitsuba, …), pbrt's Radiance.C01 to C31 (400 to 700 nm), or R, G, B (relative light at
  // 465, 550 and 610 nm), and times from `times`. Throws not_found (folder, no frames), bad_input (a gap, wrong
  // channels, no times, …). Trailing frames may be missing: frames() counts those that are there.
  explicit StackReader(std::filesystem::path folder, const FrameTimes& times = {});
  const StackInfo& info() const override { return info_; }
  const std::filesystem::path& folder() const { return folder_; }
  std::int64_t frames() const override { return frames_; }
  std::string name() const override { return folder_.string(); }
  std::string layout() const override { return layout_; }
  void will_read(std::int64_t index) const override;
  std::filesystem::path frame_path(std::int64_t index) const;

  // Decodes rows [begin, end) of a frame (end 0: all) in blocks, in order; checks its size, channels and time. May be
  // called from many threads.
  void read_rows(std::int64_t index, const RowSink& sink, int begin = 0, int end = 0) const override;
  // The whole frame as [bands][height][width].
  std::vector<float> read_frame(std::int64_t index) const;

 private:
  std::filesystem::path folder_;
  StackInfo info_;
  std::int64_t frames_ = 0;
  bool has_json_ = false;
  std::vector<std::filesystem::path> files_;  // of a foreign stack
  std::vector<std::string> channels_;         // of its bands
  std::string layout_ = "EXR stack";
};

}  // namespace pecs::sensor
