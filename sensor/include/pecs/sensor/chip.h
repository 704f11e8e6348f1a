#pragma once
// A chip profile (sensor/chips/*.json, docs/reference/sensor.md): every value with unit, range and source.
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "pecs/sensor/spectrum.h"
#include "pecs/strict_json.h"

namespace pecs::sensor {

// Values measured pixel by pixel, in place of one value for all pixels (docs/reference/sensor.md#pixel-map).
struct PixelMap {
  struct Hot {
    int x, y;
    double hz;
  };
  std::string file;
  int x = 0, y = 0, width = 0, height = 0;         // region, row by row; 0: a sample, of which every pixel draws one
  std::vector<float> threshold_on, threshold_off;  // relative to the profile's; empty: drawn
  std::vector<float> background_on_hz, background_off_hz;  // empty: the profile's
  std::optional<std::vector<Hot>> hot_pixels;              // all of the sensor; none: drawn

  // Index of a pixel's values, in a sample by `drawn` in [0, 1); none outside the region.
  std::optional<std::size_t> index(int px, int py, double drawn) const;
};

// Colour filters before the pixels, a pattern that repeats: pixel (x, y) has filter of(x, y).
struct Mosaic {
  struct Filter {
    std::string name;  // its letter in the pattern
    Spectrum transmittance;
  };
  std::vector<Filter> filters;
  std::vector<std::vector<std::uint8_t>> pattern;  // rows of indices of filters

  std::size_t of(std::size_t x, std::size_t y) const {
    const auto& row = pattern[y % pattern.size()];
    return row[x % row.size()];
  }
};

// A bias: an offset to the factory setting, and what is known of its effect.
struct Bias {
  Range allowed, recommended;
  std::string sets;                      // key of the value that it scales; empty: its effect is not published
  std::string instead;                   // key of the value to give instead; empty: there is none
  std::vector<double> offset, factor;    // measured, rising offsets; linear in ln(factor) between them
  std::optional<double> doubtful_above;  // an offset
};
using BiasSettings = std::map<std::string, double>;  // offsets by name, "diff_on"

struct Chip {
  std::string name, description;
  std::vector<std::string> trade_names;  // cameras that have the chip, and its other names
  Spectrum relative_qe;                  // peak 1; without the mosaic
  std::shared_ptr<const Mosaic> mosaic;  // or none

  // Geometry.
  double width = 0, height = 0;  // pixels; 0: any
  double pixel_pitch_m = 0;
  double fill_factor = 0;
  double peak_qe = 0;  // electrons per photon where relative_qe is 1
  // Photoreceptor.
  double dark_current_a = 0;
  double corner_hz_per_a = 0;      // 0: infinitely fast. f_w = corner_hz_per_a * (photocurrent + dark current)
  double amplifier_cutoff_hz = 0;  // of the stage behind the photoreceptor, in all light; 0: infinitely fast
  double noise_std = 0;            // of the photoreceptor's output, in ln units
  // Pixel.
  double contrast_threshold_on = 0, contrast_threshold_off = 0;  // ln units
  double threshold_mismatch = 0;                                 // standard deviation / threshold
  double refractory_period_s = 0;
  double leak_rate_hz = 0;                             // ON events of a still pixel, from the drift of its reference
  double background_on_hz = 0, background_off_hz = 0;  // Poisson events of a still pixel
  double hot_pixel_fraction = 0, hot_pixel_hz = 0;     // pixels that fire ON at random, whatever they see
  std::shared_ptr<const PixelMap> pixel_map;           // thresholds, background and hot pixels where measured
  // Readout (readout.h).
  double readout_rate_hz = 0, readout_row_s = 0;  // events per second; time to select a row. 0: no limit
  double readout_vector_px = 1;                   // pixels of a line whose events are sent at once
  // Lines are columns (1) or rows; time of one without events where lines are served in turn. 0: as they wait.
  double readout_columns = 0, readout_idle_s = 0;
  double timestamp_s = 1e-6, clock_jitter_s = 0;  // resolution; standard deviation of a row's stamp

  // Frames of the same pixels (sense/chip_frames.h); a period of 0: the chip takes none.
  double frame_period_s = 0, frame_exposure_s = 0;
  double frame_row_s = 0;                                    // delay from row to row; 0: all rows at once
  double frame_dead_s = 0;                                   // least time from an exposure's end to the next begin
  double frame_gain_e = 0, frame_gain_mismatch = 0;          // electrons per DN; relative standard deviation
  double frame_offset_dn = 0, frame_offset_mismatch_dn = 0;  // of no light; standard deviation over the pixels
  double frame_read_noise_e = 0, frame_dark_hz = 0;          // electrons; electrons/s in addition to dark_current_a
  double frame_adc_bits = 0;
  // The automatic exposure (chip_frames.cpp): davis_ros_driver's, if the mean is above 0, or libcaer's, if that is 1.
  double frame_auto_mean = 0, frame_auto_gain = 0, frame_auto_libcaer = 0;
  double frame_step = 0, frame_step_spread = 0;       // of y [ln units]: median; std of its logarithm
  double frame_step_slow = 0, frame_step_slow_s = 1;  // of what the comparators see; its time constant
  bool takes_frames = false;                          // on request: the pixels feel the exposures
  bool has_frames() const { return frame_period_s > 0; }
  bool has_auto_exposure() const { return takes_frames && (frame_auto_mean > 0 || frame_auto_libcaer > 0); }

  std::map<std::string, Range> ranges;         // of the profile's values, by their keys
  std::map<std::string, std::string> sources;  // likewise
  std::map<std::string, Bias> biases;
  BiasSettings set_biases;            // those that were set
  std::vector<std::string> warnings;  // of the biases
};

// `name`: of a profile in sensor/chips, or a path (see find_data). `overrides`: "key=value" within the profile's range.
// Throws not_found for an unknown name, bad_input for a bad profile, usage for a bad or a repeated override.
// `biases`: offsets; throws usage for an unknown one, one out of range, one without a published effect, and one whose
// value is also overridden.
Chip load_chip(const std::string& name, const std::vector<std::string>& overrides = {},
               const BiasSettings& biases = {});

// "diff_on=35,diff_off=-10", names with or without "bias_". Throws usage.
BiasSettings biases_from(const std::string& text);
// Metavision's .bias file (lines "value % name") or its camera settings in JSON. `ignored`: names of the other settings
// of the JSON that are enabled. Throws bad_input, naming the line.
BiasSettings read_bias_file(const std::filesystem::path& file, std::vector<std::string>& ignored);

// The biases of a profile; for load_chip.
std::map<std::string, Bias> read_biases(JsonObject object, const std::map<std::string, Range>& values);
void apply_biases(Chip& chip, const BiasSettings& biases, const std::vector<std::string>& overrides);

// Photon noise, leak, background events, hot pixels and mismatch off: a still scene gives no events.
Chip without_noise(Chip chip);

// Throws bad_input for a picture larger than the chip, naming `source` and, at its end, the remedy.
void check_fits(const Chip& chip, int width, int height, const std::string& source, const std::string& remedy = "");
// Sets takes_frames, for which `option` asks. Throws usage for a chip without frames, and for overrides of frames that
// have no effect.
void take_frames(Chip& chip, bool takes, const std::string& option, const std::vector<std::string>& overrides);

// All values with their units and the relative quantum efficiency, after overrides, for run records.
Json chip_to_json(const Chip& chip);

}  // namespace pecs::sensor
