#pragma once
// Sources of light: EXR stacks (stack.h), and pictures and video (pictures.h, which needs OpenCV).
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "pecs/sensor/bands.h"
#include "pecs/strict_json.h"
#include "pecs/time_unit.h"

namespace pecs::sensor {

// Larger pictures are an error before anything is allocated for them.
inline constexpr int kMaxSide = 8192;

// W m^-2 nm^-1 on the film, W m^-2 sr^-1 nm^-1 along the ray, or relative: 1 is white.
enum class Quantity { irradiance, radiance, relative };
constexpr const char* name_of(Quantity q) {
  return q == Quantity::irradiance ? "irradiance" : q == Quantity::radiance ? "radiance" : "relative";
}
// Units as in the OpenEXR layout for spectral images.
constexpr const char* unit_of(Quantity q) {
  return q == Quantity::irradiance ? "W.m^-2.nm^-1" : q == Quantity::radiance ? "W.m^-2.sr^-1.nm^-1" : "1";
}

// A layer of a stack: files of one kind, one per frame, or one per interval between neighbouring frames (with a period,
// one more: from the last frame on).
struct Layer {
  std::string name, prefix;           // files are <prefix>000000.exr, …
  std::vector<std::string> channels;  // in the order of values
  std::string unit;
  bool per_interval = false;
};
inline constexpr const char *kLight = "light", *kNoise = "noise", *kMotion = "motion";

struct StackInfo {
  Quantity quantity = Quantity::irradiance;
  int width = 0, height = 0;  // pixels
  int subpixels = 1;          // values per pixel in a stack's files, along x and along y
  int file_width() const { return width * subpixels; }
  int file_height() const { return height * subpixels; }
  bool has_between = false;  // there may be pictures between frames
  bool has_noise = false;    // files of light have the channel kNoise: the layer of that name, after the light
  bool has_light = true;     // false: only other layers; reading the light throws
  std::optional<double> pixel_pitch_m;
  std::optional<double> fnumber;  // of the camera, for radiance
  std::vector<Band> bands;
  std::vector<std::int64_t> times_ns;  // increasing
  std::optional<std::int64_t> period_ns;
  std::vector<Layer> layers;  // of an EXR stack; the first is the light
};

// Rows [begin, end) of frames.
struct Region {
  int begin = 0, end = 0;
};

// Rows of one frame: values[(band * rows + row) * width + x].
using RowSink = std::function<void(int first_row, int rows, std::span<const float> values)>;

// All rows that `read` gives to its sink: [plane][height][width].
std::vector<float> whole_frame(std::size_t planes, int width, int height,
                               const std::function<void(const RowSink&)>& read);

// Measurements of the frames read so far, for the run record, and what a user should know of them.
struct SourceReport {
  Json results;
  std::vector<std::string> warnings;
};

class FrameSource {
 public:
  virtual ~FrameSource() = default;
  virtual const StackInfo& info() const = 0;
  virtual std::int64_t frames() const = 0;
  virtual std::string name() const = 0;    // for errors
  virtual std::string layout() const = 0;  // kind of source: "EXR stack", "RGB EXR", ...
  // Rows [begin, end) of a frame (end 0: all) in blocks, in order. Thread-safe.
  virtual void read_rows(std::int64_t index, const RowSink& sink, int begin = 0, int end = 0) const = 0;
  // All rows of a frame with its subpixels: width * subpixels columns.
  virtual void read_fine_rows(std::int64_t index, const RowSink& sink) const { read_rows(index, sink); }
  virtual void will_read(std::int64_t) const {}  // hint: the frame is read soon
  // Whether the source has motion (the layer kMotion), and all rows of the motion of the interval that begins at a
  // frame, in the channels that Carrier takes (motion.h). Thread-safe.
  virtual bool has_motion() const { return false; }
  virtual void read_motion(std::int64_t, const RowSink&) const {}
  // Whether this motion is an estimate. Then bit k of unsure() is set where light in the k-th eighth of the interval
  // that begins at a frame is a guess, [height * width]. Thread-safe.
  virtual bool estimates_motion() const { return false; }
  virtual std::vector<std::uint8_t> unsure(std::int64_t) const { return {}; }
  // Options with which the frames have this size; empty where there are none.
  virtual std::string options_for(int, int) const { return {}; }
  virtual SourceReport report() const { return {}; }
  // Pictures within the interval that begins at a frame: their times, on the clock of info().times_ns, increasing; and
  // all rows of one of them with its subpixels, NaN where it was not rendered.
  virtual std::vector<std::int64_t> between_ns(std::int64_t) const { return {}; }
  virtual void read_between(std::int64_t, std::size_t, const RowSink&) const {}
  // With info().has_noise, the renderer's noise in ln(photocurrent), a signed sample of its standard deviation: all
  // rows with subpixels, of a frame and of a picture within an interval.
  virtual void read_noise(std::int64_t, const RowSink&) const {}
  virtual void read_between_noise(std::int64_t, std::size_t, const RowSink&) const {}
};

// Times of frames that have none: by frame rate, or from a text file with one time per line ('#' starts a comment), in
// us unless `unit` is another. Throws bad_input for neither, a wrong number of lines, times that do not increase, or
// times that are hardly us where no unit is given; usage for both.
struct FrameTimes {
  std::optional<double> fps;
  std::optional<std::filesystem::path> file_us;
  std::optional<TimeUnit> unit;                                                        // of file_us
  std::vector<std::int64_t> of(std::int64_t frames, const std::string& source) const;  // ns
};

// Files of a folder with one of these endings (lower case, with the dot), in natural order: frame_2 before frame_10.
// Hidden files are left out.
std::vector<std::filesystem::path> files_in_order(const std::filesystem::path& folder,
                                                  std::span<const std::string> endings);
// The same for frames. Unless a file has their times, their numbers must rise in equal steps: throws bad_input for a
// gap, and for two files of one number.
std::vector<std::filesystem::path> frame_files(const std::filesystem::path& folder,
                                               std::span<const std::string> endings, const FrameTimes& times);

}  // namespace pecs::sensor
