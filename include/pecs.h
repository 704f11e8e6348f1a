/* The C interface of PECS: everything other languages bind to. Opaque handles; errors come back in a pecs_error that
 * the caller owns; no exception crosses. Options and reports are JSON text in UTF-8 (keys are documented in docs/);
 * bulk data are plain arrays. A handle may be used by one thread at a time. */
#ifndef PECS_H
#define PECS_H

#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32)
#define PECS_API __declspec(dllexport)
#else
#define PECS_API __attribute__((visibility("default")))
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pecs_error {
  int code;           /* 0 = no error; else as the program's exit codes (docs/exit_codes.md) */
  char message[1024]; /* one line: file, place, got, wanted; UTF-8, zero-terminated */
} pecs_error;

PECS_API const char* pecs_version(void);

/* Frees any text that a pecs_ function returned as char*. */
PECS_API void pecs_text_free(char* text);

/* The folder of the data files that ship with PECS: "lens_data/spectra", "sensor/chips", ... NULL on error. */
PECS_API char* pecs_data_dir(const char* room, pecs_error* error);

/* ---- lens (blender_addon/lens) ------------------------------------------------------------------------------- */

typedef struct pecs_lens pecs_lens;
PECS_API pecs_lens* pecs_lens_open(const char* path, pecs_error* error); /* NULL on error */
PECS_API void pecs_lens_close(pecs_lens* lens);

/* First-order data. options: {"lambda_nm": 587.56, "focus_m": metres | null (infinity), "stop_diameter_mm": mm | null,
 * "fnumber": N | null, "film_width_mm", "film_height_mm"}; result: docs/lens.md. */
PECS_API char* pecs_lens_info(const pecs_lens* lens, const char* options_json, pecs_error* error);

/* The pupil's table at one wavelength, over the film radius: ellipses, exact areas, irradiance. Options as for info. */
PECS_API char* pecs_lens_pupil(const pecs_lens* lens, const char* options_json, pecs_error* error);

/* The camera for Cycles. options: {"bands_nm": [b0, b1, b2], "focus_m": 1.56 (null = infinity), "focus_bands_nm":
 * [...], "stop_diameter_mm": null | mm, "fnumber": null | N, "film_width_mm": w, "film_height_mm": h, "pixel_pitch_mm":
 * p, "colour_tolerance_px": 0.1}. focus_bands_nm are all bands of the stack, so that every pass has one focus. result:
 * {"osl": source of one shader, "shader_name":
 * ..., "e0": [E0 per band: film irradiance in W m^-2 nm^-1 per unit scene radiance in W m^-2 sr^-1 nm^-1 on the axis;
 * film irradiance = rendered value * e0 of its channel], "film_z_mm", "focus_m", "stop_diameter_mm", "fnumber",
 * "channel_mode", "lens_name", "sha256", ...: docs/lens.md}. */
PECS_API char* pecs_lens_camera(const pecs_lens* lens, const char* options_json, pecs_error* error);

/* The lens in section with its rays, as SVG text. Options as for info ("bands_nm": the rays' wavelengths). */
PECS_API char* pecs_lens_draw(const pecs_lens* lens, const char* options_json, pecs_error* error);

/* Which direction of the scene lands on which pixel, by chief rays (conventions: pecs/lens/image_map.h, docs/lens.md).
 * options: {"width": pixels, "height": pixels, "pixel_pitch_mm", "lambda_nm": 550, "focus_bands_nm": [...], "focus_m",
 * "stop_diameter_mm", "fnumber", "film_shift_x_mm", "film_shift_y_mm", "film_tilt_x_deg", "film_tilt_y_deg"}.
 * pixels: [count][2]; directions: [count][3], unit length; NaN where no chief ray arrives. capacity: of the result, in
 * pixels or directions. Returns count, -1 on error. */
PECS_API int64_t pecs_lens_directions(const pecs_lens* lens, const char* options_json, const double* pixels,
                                      int64_t count, double* directions, int64_t capacity, pecs_error* error);
PECS_API int64_t pecs_lens_pixels(const pecs_lens* lens, const char* options_json, const double* directions,
                                  int64_t count, double* pixels, int64_t capacity, pecs_error* error);

/* Blurs one band's picture in place by the diffraction of a round pupil (working f-number: the camera's result).
 * pixels: [height][width]; mirrored beyond the border. 0 = done. */
PECS_API int pecs_lens_diffract(float* pixels, int width, int height, double pixel_pitch_mm, double lambda_nm,
                                double working_fnumber, pecs_error* error);

/* ---- bands and EXR stacks (sensor) --------------------------------------------------------------------------- */

/* Wavelengths and weights. options: {"chip": "imx636" | path, "n": 6, "placement": "gauss" | "strata" | "uniform",
 * "illuminant": null | "d65", "lamp.csv", "blackbody:T", "daylight:T" | [[lambda_nm, relative power], ...], "min_nm":
 * .., "max_nm": ..} (default range: where the QE and the illuminant are tabulated; the illuminant is linear between its
 * points: use it so in the scene too). result: {"bands": [{"lambda_nm": .., "weight_nm": ..}, ...]}: integral over
 * lambda of f(lambda) dlambda ~ sum of weight_nm * f(lambda_nm) (docs/exr_stack.md). */
PECS_API char* pecs_bands(const char* options_json, pecs_error* error);

typedef struct pecs_stack_writer pecs_stack_writer;
/* Opens a new stack in `folder`, or continues one whose stack.json says the same (else bad_output names the key that
 * differs). stack_json: docs/exr_stack.md. */
PECS_API pecs_stack_writer* pecs_stack_create(const char* folder, const char* stack_json, pecs_error* error);
PECS_API int pecs_stack_has_frame(const pecs_stack_writer* stack, int64_t index); /* 1 if whole on disk */
/* values: [bands][height][width], row 0 at the top, in the stack's unit. The file appears whole or not at all. 0 =
 * done. */
PECS_API int pecs_stack_write_frame(pecs_stack_writer* stack, int64_t index, const float* values, pecs_error* error);
PECS_API void pecs_stack_close(pecs_stack_writer* stack);

typedef struct pecs_stack_reader pecs_stack_reader;
/* fps: the times of a folder without stack.json; 0 if it has one. */
PECS_API pecs_stack_reader* pecs_stack_open(const char* folder, double fps, pecs_error* error);
/* {"quantity", "width", "height", "bands", "times_ns", "frames" (on disk now), "pixel_pitch_m", "period_ns"} */
PECS_API char* pecs_stack_reader_info(const pecs_stack_reader* stack, pecs_error* error);
/* values: [bands][height][width], filled. 0 = done. */
PECS_API int pecs_stack_read_frame(const pecs_stack_reader* stack, int64_t index, float* values, pecs_error* error);
PECS_API void pecs_stack_reader_close(pecs_stack_reader* stack);

/* ---- event files (sensor/events) ----------------------------------------------------------------------------- */

/* docs/event_file.md: t in integer microseconds, x right, y down, p 1 = brighter. */
typedef struct pecs_event {
  int64_t t_us;
  uint16_t x, y;
  uint8_t p;
  uint8_t unused[3];
} pecs_event;

/* [{"name": "evt3", "description": .., "extensions": [".raw"], "reads": true, "writes": true}, ...] */
PECS_API char* pecs_event_formats(pecs_error* error);

typedef struct pecs_event_reader pecs_event_reader;
/* format: a name of the list above, or NULL: found from the content. NULL on error. */
PECS_API pecs_event_reader* pecs_events_open(const char* path, const char* format, pecs_error* error);
/* {"format": .., "width": .., "height": .., "camera": ..}; width and height are 0 for a file that does not say, until
 * all events are read. */
PECS_API char* pecs_events_info(const pecs_event_reader* reader, pecs_error* error);
/* Reads at most `capacity` events into `out`; returns how many: 0 at the end, -1 on error. */
PECS_API int64_t pecs_events_read(pecs_event_reader* reader, pecs_event* out, int64_t capacity, pecs_error* error);
PECS_API void pecs_events_close(pecs_event_reader* reader);

typedef struct pecs_event_writer pecs_event_writer;
/* options: {"width": w, "height": h, "camera": "", "format": null | name (null: from the extension)}. NULL on error. */
PECS_API pecs_event_writer* pecs_events_create(const char* path, const char* options_json, pecs_error* error);
/* Events sorted by t_us. 0 = done. */
PECS_API int pecs_events_write(pecs_event_writer* writer, const pecs_event* events, int64_t count, pecs_error* error);
/* Completes the file: it appears under its name now. 0 = done. */
PECS_API int pecs_events_finish(pecs_event_writer* writer, pecs_error* error);
/* Frees the writer; a file that was not finished stays as <path>.partial. */
PECS_API void pecs_events_discard(pecs_event_writer* writer);

/* ---- the sensor on frames in memory (sensor) ------------------------------------------------------------------ */

typedef struct pecs_sensor pecs_sensor;
/* options: {"width": w, "height": h, "chip": "imx636" | path, "overrides": {"key": value, ...}, "no_noise": false,
 * "seed": 1, "threads": 0 (all), "photocurrent_a": amperes for a value of 1, "model": "pecs" | "esim" | …,
 * "parameters": {"key": value, …} of the model, "readout": "chip" | "ideal", "labels": false}. NULL on error. */
PECS_API pecs_sensor* pecs_sensor_open(const char* options_json, pecs_error* error);
/* frames: [count][height][width], linear light; t_us: their times, rising from push to push. An interval's events come
 * with the second frame after it, or when `last` says that no frame follows. Returns how many there are, -1 on error.
 */
PECS_API int64_t pecs_sensor_push(pecs_sensor* sensor, const float* frames, const double* t_us, int64_t count, int last,
                                  pecs_error* error);
/* Copies the events of the last push, sorted by time, then row, then column. */
PECS_API void pecs_sensor_events(const pecs_sensor* sensor, pecs_event* out);
/* With "labels": why each of them came: 0 signal, 1 leak, 2 noise, 3 hot pixel. */
PECS_API void pecs_sensor_labels(const pecs_sensor* sensor, uint8_t* out);
/* Events lost so far because their pixel still waited to be read. */
PECS_API int64_t pecs_sensor_dropped(const pecs_sensor* sensor);
PECS_API void pecs_sensor_close(pecs_sensor* sensor);

/* ---- comparison (calibration) --------------------------------------------------------------------------------- */

/* Distances and summaries (docs/metrics.md). options: {"width": pixels, "height": pixels, "normalisation": "shared" |
 * "eq16" | "paper", "window_us": null | integer, "origin": "first-event" | "zero", "split_half": true,
 * "seed": 1, "disk": null | what `pecs align detect --json` prints}.
 * result: as printed by `pecs compare --json`. */
PECS_API char* pecs_compare(const pecs_event* real, int64_t real_count, const pecs_event* sim, int64_t sim_count,
                            const char* options_json, pecs_error* error);

/* Delays of one stream's events behind the edges of a turning disk (docs/metrics.md). Events in time order. options:
 * {"width": pixels, "height": pixels, "duration_us": the events lie in [0, this), "disk": what `pecs align detect
 * --json` prints}. result: as "delays" of pecs_compare, for one stream, and by regions of the disk. */
PECS_API char* pecs_delays(const pecs_event* events, int64_t count, const char* options_json, pecs_error* error);

#ifdef __cplusplus
}
#endif
#endif
