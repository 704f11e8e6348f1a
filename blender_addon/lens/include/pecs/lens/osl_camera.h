#pragma once
// A camera for Cycles: one generated OSL shader per lens, focus, stop and pass of up to three bands.
//
// The camera looks along Blender's -Z with +Y up, its origin at the centre of the entrance pupil; the picture is
// upright (the film picture turned by 180 degrees), as the built-in perspective camera's.
#include <optional>
#include <string>
#include <vector>

#include "pecs/lens/first_order.h"
#include "pecs/lens/pupil.h"

namespace pecs::lens {

struct CameraOptions {
  std::vector<double> bands_nm;        // 1 to 3: the red, green and blue channel of a pass
  std::vector<double> focus_bands_nm;  // all bands of the stack; empty: bands_nm
  std::optional<double> focus_m;       // none = infinity
  double stop_diameter_mm = kWideOpen;
  double film_width_mm = 6.2208, film_height_mm = 3.4992;
  double film_shift_x_mm = 0, film_shift_y_mm = 0;  // of the film's centre off the axis (+x right, +y up, from behind)
  // Tilt of the film about its centre: first about its own x axis, then about the lens frame's y axis (right-handed).
  double film_tilt_x_deg = 0, film_tilt_y_deg = 0;
  double pixel_pitch_mm = 0.00486;
  // The bands of a pass share their rays if this moves images by at most so much: Camera::colour_shift_px, else
  // Camera::mixed_shift_px.
  double colour_tolerance_px = 0.1;
  // Shares of the bands in the signal of a sensor that adds them up, sum 1; empty: bands are seen apart.
  // `share_spreads`: how much the sums of shares up to each border between bands vary with the scene's colours (RMS).
  std::vector<double> band_shares, share_spreads;
  double unit_m = 1;  // of the scene's coordinates
};

// All channels of a sample are traced at the mean wavelength, or at that of one band: drawn by `band_shares` for all
// channels (their sum is exact for colours that have these shares), or with equal shares for the band's channel alone.
enum class ChannelMode { mean, mixed, per_channel };

struct Camera {
  CameraOptions options;  // resolved
  std::string osl, shader_name;
  Focus focus;
  FirstOrder first_order;     // at the mean of the focus bands
  std::vector<double> e0_sr;  // per band: film irradiance per scene radiance on the axis
  ChannelMode channel_mode;
  // RMS errors of position that chose the mode: of a band traced at the mean, and of the scene's colours traced mixed.
  double colour_shift_px, mixed_shift_px;
  std::vector<PupilTables> tables;                               // one, or one per band
  double acceptance_centre, acceptance_half, acceptance_corner;  // exact area / sampled area
};

Camera make_camera(const Prescription& lens, const CameraOptions& options);

}  // namespace pecs::lens
