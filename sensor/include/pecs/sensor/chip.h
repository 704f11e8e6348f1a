#pragma once
// A chip profile (sensor/chips/*.json, docs/reference/sensor.md): every value with unit, range and source.
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "pecs/sensor/spectrum.h"
#include "pecs/strict_json.h"

namespace pecs::sensor {

// Measured rates of noise events [Hz], in place of one rate for all pixels.
struct NoiseTable {
  std::string file;
  int width = 0, height = 0;         // of the sensor, row by row; 0: a sample, of which every pixel draws one
  std::vector<float> on_hz, off_hz;  // of one pixel each
};

struct Chip {
  std::string name, description;
  Spectrum relative_qe;  // peak 1

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
  std::shared_ptr<const NoiseTable> noise_table;       // their rates pixel by pixel, where measured
  double hot_pixel_fraction = 0, hot_pixel_hz = 0;     // pixels that fire ON at random, whatever they see
  // Readout (readout.h).
  double readout_rate_hz = 0, readout_row_s = 0;  // events per second; time to select a row. 0: no limit
  double readout_group_rows = 1;                  // rows that are read at once
  double timestamp_s = 1e-6, clock_jitter_s = 0;  // resolution; standard deviation of a row's stamp

  std::map<std::string, Range> ranges;  // of the profile's values, by their keys
};

// `name`: of a profile in sensor/chips, or a path (see find_data). `overrides`: "key=value" within the profile's range.
// Throws not_found for an unknown name, bad_input for a bad profile, usage for a bad or a repeated override.
Chip load_chip(const std::string& name, const std::vector<std::string>& overrides = {});

// Photon noise, leak, background events, hot pixels and mismatch off: a still scene gives no events.
Chip without_noise(Chip chip);

// Throws bad_input for a picture larger than the chip, naming `source`.
void check_fits(const Chip& chip, int width, int height, const std::string& source);

// All values with their units and the relative quantum efficiency, after overrides, for run records.
Json chip_to_json(const Chip& chip);

}  // namespace pecs::sensor
