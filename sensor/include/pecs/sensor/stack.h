#pragma once
// The EXR stack (docs/reference/exr_stack.md): a folder with stack.json and OpenEXR files, one per instant
// and layer. Conventions: row 0 is the top of the picture; times in ns from the start of the stack; bands by
// increasing wavelength. A layer is given by its name; the light's is kLight.
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "pecs/sensor/bands.h"
#include "pecs/sensor/source.h"
#include "pecs/strict_json.h"

namespace pecs::sensor {

inline constexpr int kMaxBands = 256;

// Checks every key of stack.json; `file` is named in errors.
StackInfo parse_stack_info(const Json& json, const std::string& file);

// Throws bad_input naming `folder` for a layer that the stack lacks.
const Layer& layer_of(const StackInfo& info, std::string_view name, const std::filesystem::path& folder);
// Number of files of a layer in a complete stack.
std::int64_t planned_frames(const StackInfo& info, const Layer& layer);
// Begin and end of an interval between neighbouring frames. Throws bad_input naming `folder` for a wrong index.
std::pair<std::int64_t, std::int64_t> interval_ns(const StackInfo& info, std::int64_t interval,
                                                  const std::filesystem::path& folder);
// Values of a layer's frame: [channels][rows][columns] of its file.
std::size_t frame_values(const StackInfo& info, const Layer& layer);
Json to_json(const Layer& layer);

class StackWriter {
 public:
  // Creates the folder and writes stack.json first, or continues a stack with an equal stack.json. Throws bad_output
  // naming the key that differs.
  StackWriter(std::filesystem::path folder, const Json& stack_json);
  const StackInfo& info() const { return info_; }
  const std::filesystem::path& folder() const { return folder_; }
  // Whether the frame is complete on disk: its last row can be read and its time is right.
  bool has_frame(std::int64_t index, std::string_view layer = kLight) const;
  // values: [channels][rows][columns]; of light with noise, the noise follows the bands. The file appears complete or
  // not at all. Light is rounded to 12 bits of mantissa, its noise to 4.
  void write_frame(std::int64_t index, std::span<const float> values, std::string_view layer = kLight) const;
  // A picture within an interval, NaN where it was not rendered; `number` increases with the time. has_between: whether
  // it is complete on disk.
  bool has_between(std::int64_t interval, std::int64_t number, std::int64_t time_ns) const;
  void write_between(std::int64_t interval, std::int64_t number, std::int64_t time_ns,
                     std::span<const float> values) const;

 private:
  Layer written(const Layer& layer) const;  // with all channels of its files
  bool is_whole(const std::filesystem::path& path, const Layer& layer, std::int64_t time_ns) const;
  void write(const std::filesystem::path& path, const Layer& layer, std::int64_t time_ns,
             std::span<const float> values) const;

  std::filesystem::path folder_;
  StackInfo info_;
};

class StackReader : public FrameSource {
 public:
  // Reads stack.json; without one, the header of the first EXR file (of any name, in natural order): spectral channels
  // S0.<wavelength>nm (pbrt-v4, Mitsuba, …), pbrt's Radiance.C01 to C31 (400 to 700 nm), or R, G, B (relative light at
  // 465, 550 and 610 nm), and times from `times`. Throws not_found (folder, no frames), bad_input (a gap, wrong
  // channels, no times, …). Trailing frames may be missing: frames() counts those of the light on disk; in a stack
  // without light, the times.
  explicit StackReader(std::filesystem::path folder, const FrameTimes& times = {});
  const StackInfo& info() const override { return info_; }
  const std::filesystem::path& folder() const { return folder_; }
  std::int64_t frames() const override { return frames_; }
  std::string name() const override { return folder_.string(); }
  std::string layout() const override { return layout_; }
  SourceReport report() const override;
  void will_read(std::int64_t index) const override;
  // Throw bad_input naming stack.json if the layer of that name is not a motion layer.
  bool has_motion() const override;
  void read_motion(std::int64_t interval, const RowSink& sink) const override;
  std::filesystem::path frame_path(std::int64_t index) const;

  // Decodes rows [begin, end) of a frame of the light (end 0: all) in blocks, in order; checks its size, channels and
  // time. Subpixels are averaged. Thread-safe.
  void read_rows(std::int64_t index, const RowSink& sink, int begin = 0, int end = 0) const override;
  // All rows of the file, with subpixels.
  void read_fine_rows(std::int64_t index, const RowSink& sink) const override;
  std::vector<std::int64_t> between_ns(std::int64_t interval) const override;
  void read_between(std::int64_t interval, std::size_t which, const RowSink& sink) const override;
  void read_noise(std::int64_t index, const RowSink& sink) const override;
  void read_between_noise(std::int64_t interval, std::size_t which, const RowSink& sink) const override;
  // The whole file as [channels][rows][columns].
  std::vector<float> read_frame(std::int64_t index, std::string_view layer = kLight) const;
  std::vector<float> read_between(std::int64_t interval, std::size_t which) const;

 private:
  void read_rows(std::int64_t index, const Layer& layer, const RowSink& sink, int begin, int end) const;
  void read_file(const std::filesystem::path& path, const Layer& layer, std::optional<std::int64_t> time_ns,
                 const RowSink& sink, int begin, int end) const;
  std::filesystem::path between_path(std::int64_t interval, std::size_t which) const;

  std::filesystem::path folder_;
  StackInfo info_;
  std::int64_t frames_ = 0;
  bool has_json_ = false;
  std::vector<std::filesystem::path> files_;                   // of a foreign stack
  std::map<std::int64_t, std::vector<std::int64_t>> between_;  // numbers of the pictures within an interval
  std::string layout_ = "EXR stack";
  std::pair<int, int> corner_;                   // of a foreign stack's frames
  std::optional<std::int64_t> header_shift_ns_;  // of times in headers from times_ns; nothing: headers have none
};

}  // namespace pecs::sensor
