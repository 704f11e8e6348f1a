/* The C interface of PECS: everything other languages bind to.
 *
 * A type pecs_T is an opaque handle: pecs_T_open reads, pecs_T_create writes a new file and pecs_T_finish completes it,
 * pecs_T_close frees any of them (NULL too). A handle may be used by one thread at a time.
 * A function that fails returns -1, or NULL for a handle or text, and says why in the pecs_error (which may be NULL)
 * that the caller owns; no exception crosses. An int that has nothing to say is 0. Every array that is written to has a
 * capacity, in elements. Options and reports are JSON text in UTF-8 (keys: here and in docs/; an unknown one is
 * refused, null is as absent); bulk data are plain arrays, row 0 at the top. examples/c/ holds a program to start from.
 */
#ifndef PECS_H
#define PECS_H

#include <stddef.h>
#include <stdint.h>

#if !defined(_WIN32)
#define PECS_API __attribute__((visibility("default")))
#elif defined(PECS_BUILDS_LIBRARY)
#define PECS_API __declspec(dllexport)
#else
#define PECS_API __declspec(dllimport)
#endif

/* Of this header; pecs_version() is the library's. */
#define PECS_VERSION_MAJOR 0
#define PECS_VERSION_MINOR 1
#define PECS_VERSION_PATCH 0
#define PECS_VERSION "0.1.0"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pecs_error {
  int code;           /* 0 = no error; else as the program's exit codes (docs/reference/exit_codes.md) */
  char message[1024]; /* one line: file, place, got, wanted; UTF-8, zero-terminated */
} pecs_error;

PECS_API const char* pecs_version(void);

/* Frees any text that a pecs_ function returned as char*. NULL does nothing. */
PECS_API void pecs_text_free(char* text);

/* The folder of the data files that ship with PECS: "lens_data/spectra", "sensor/chips", ... */
PECS_API char* pecs_data_dir(const char* folder, pecs_error* error);

/* ---- lens (blender_addon/lens) ------------------------------------------------------------------------------- */

typedef struct pecs_lens pecs_lens;
PECS_API pecs_lens* pecs_lens_open(const char* path_or_name, pecs_error* error);
PECS_API void pecs_lens_close(pecs_lens* lens);

/* First-order data. options: {"lambda_nm": 587.56, "focus_m": metres | null (infinity), "stop_diameter_mm": mm | null,
 * "fnumber": N | null, "film_width_mm", "film_height_mm"}; result: docs/reference/lens.md. */
PECS_API char* pecs_lens_info(const pecs_lens* lens, const char* options_json, pecs_error* error);

/* The pupil's table at one wavelength, over the film radius: ellipses, exact areas, irradiance. Options as for info. */
PECS_API char* pecs_lens_pupil(const pecs_lens* lens, const char* options_json, pecs_error* error);

/* The camera for Cycles. options: {"bands_nm": [b0, b1, b2], "focus_m": 1.56 (null = infinity), "focus_bands_nm":
 * [...], "stop_diameter_mm": null | mm, "fnumber": null | N, "film_width_mm": w, "film_height_mm": h, "pixel_pitch_mm":
 * p, "colour_tolerance_px": 0.1, "band_shares": [s0, s1, s2], "share_spreads": [r01, r12], "unit_m": 1 (metres per unit
 * of the scene)}. focus_bands_nm are all bands of the stack, so that every pass has one focus. result: {"osl": source
 * of one shader, "shader_name": .., "e0": [E0 per band: film irradiance in W m^-2 nm^-1 per unit scene radiance in W
 * m^-2 sr^-1 nm^-1 on the axis; film irradiance = rendered value * e0 of its channel], "film_z_mm", "focus_m",
 * "stop_diameter_mm", "fnumber", "channel_mode", "lens_name", "sha256", ...: docs/reference/lens.md}. */
PECS_API char* pecs_lens_camera(const pecs_lens* lens, const char* options_json, pecs_error* error);

/* The lens in section with its rays, as SVG text. Options as for info ("bands_nm": the rays' wavelengths). */
PECS_API char* pecs_lens_draw(const pecs_lens* lens, const char* options_json, pecs_error* error);

/* Which direction of the scene lands on which pixel, by chief rays (conventions: pecs/lens/image_map.h,
 * docs/reference/lens.md). options: {"width": pixels, "height": pixels, "pixel_pitch_mm", "lambda_nm": 550,
 * "focus_bands_nm": [...], "focus_m", "stop_diameter_mm", "fnumber", "film_shift_x_mm", "film_shift_y_mm",
 * "film_tilt_x_deg", "film_tilt_y_deg"}. pixels: [count][2]; directions: [count][3], unit length; NaN where no chief
 * ray arrives. capacity: of the result, in pixels or directions. Returns count. */
PECS_API int64_t pecs_lens_directions(const pecs_lens* lens, const char* options_json, const double* pixels,
                                      int64_t count, double* directions, int64_t capacity, pecs_error* error);
PECS_API int64_t pecs_lens_pixels(const pecs_lens* lens, const char* options_json, const double* directions,
                                  int64_t count, double* pixels, int64_t capacity, pecs_error* error);

/* Blurs one band's picture in place by the diffraction of a round pupil (working f-number: the camera's result).
 * pixels: [height][width]; mirrored beyond the border. */
PECS_API int pecs_lens_diffract(float* pixels, int width, int height, double pixel_pitch_mm, double lambda_nm,
                                double working_fnumber, pecs_error* error);

/* Refractive index relative to air at `count` wavelengths. options: {"name": "N-BK7" | "schott/N-BK7"}, of
 * lens_data/glasses by its own formula, or {"nd": 1.5168, "vd": 64.2}, by Hartmann's formula through both and the
 * normal line. A wavelength outside the formula's range is an error. Returns count. */
PECS_API int64_t pecs_glass_index(const char* options_json, const double* lambda_nm, int64_t count, double* index,
                                  int64_t capacity, pecs_error* error);

/* ---- spectra, bands and EXR stacks (sensor) -------------------------------------------------------------------- */

/* A tabulated spectrum: "d65", "colorchecker/red" (names of lens_data/spectra), a .csv file (wavelength in nm, value),
 * "blackbody:T" or "daylight:T" (T in K); "basis/srgb": a table of three functions. result: rows [[lambda_nm, value,
 * ...], ...] at increasing wavelengths, linear in between. */
PECS_API char* pecs_spectrum(const char* name_or_path, pecs_error* error);

/* Wavelengths and weights. options: {"chip": "imx636" | path, "n": 6, "placement": "gauss" | "uniform",
 * "illuminant": null | "d65", "lamp.csv", "blackbody:T", "daylight:T" | [[lambda_nm, relative power], ...], "min_nm":
 * .., "max_nm": ..} (default range: where the QE and the illuminant are tabulated; the illuminant is linear between its
 * points: use it so in the scene too). result: {"bands": [{"lambda_nm": .., "weight_nm": ..}, ...]}: integral over
 * lambda of f(lambda) dlambda ~ sum of weight_nm * f(lambda_nm) (docs/reference/exr_stack.md). */
PECS_API char* pecs_bands(const char* options_json, pecs_error* error);

/* Stacks (docs/reference/exr_stack.md). `layer` is a layer's name; NULL is the light, whose channels are the bands.
 * Values are [channels][rows][columns] of the stack's files, row 0 at the top, in the layer's unit. */
typedef struct pecs_stack_writer pecs_stack_writer;
/* Opens a new stack in `folder`, or continues one whose stack.json says the same (else bad_output names the key that
 * differs). */
PECS_API pecs_stack_writer* pecs_stack_writer_create(const char* folder, const char* stack_json, pecs_error* error);
/* 1 if the frame is whole on disk, 0 if not. */
PECS_API int pecs_stack_writer_has_frame(const pecs_stack_writer* stack, const char* layer, int64_t index,
                                         pecs_error* error);
/* count: of values; in a stack with "noise", this channel follows the bands. The file appears whole or not at all. */
PECS_API int pecs_stack_writer_write_frame(pecs_stack_writer* stack, const char* layer, int64_t index,
                                           const float* values, int64_t count, pecs_error* error);
/* Light at an instant within an interval, NaN where it was not rendered; `number` rises with the time. */
PECS_API int pecs_stack_writer_has_between(const pecs_stack_writer* stack, int64_t interval, int64_t number,
                                           int64_t time_ns, pecs_error* error);
PECS_API int pecs_stack_writer_write_between(pecs_stack_writer* stack, int64_t interval, int64_t number,
                                             int64_t time_ns, const float* values, int64_t count, pecs_error* error);
PECS_API void pecs_stack_writer_close(pecs_stack_writer* stack);

typedef struct pecs_stack_reader pecs_stack_reader;
/* fps: the times of a folder without stack.json; 0 if it has one. */
PECS_API pecs_stack_reader* pecs_stack_reader_open(const char* folder, double fps, pecs_error* error);
/* {"quantity", "width", "height", "subpixels", "bands", "layers": [{"name", "channels", "unit", "at"}, ...] (the light
 * first), "times_ns", "frames" (on disk now), "pixel_pitch_m", "period_ns"}. */
PECS_API char* pecs_stack_reader_info(const pecs_stack_reader* stack, pecs_error* error);
/* values: of `capacity` floats, filled. */
PECS_API int pecs_stack_reader_read_frame(const pecs_stack_reader* stack, const char* layer, int64_t index,
                                          float* values, int64_t capacity, pecs_error* error);
/* How many pictures lie within an interval; times_ns: of `capacity`, filled with the first ones' times. */
PECS_API int64_t pecs_stack_reader_between(const pecs_stack_reader* stack, int64_t interval, int64_t* times_ns,
                                           int64_t capacity, pecs_error* error);
/* The light of one of them, NaN where it was not rendered. */
PECS_API int pecs_stack_reader_read_between(const pecs_stack_reader* stack, int64_t interval, int64_t which,
                                            float* values, int64_t capacity, pecs_error* error);
PECS_API void pecs_stack_reader_close(pecs_stack_reader* stack);

/* ---- event files (sensor/events) ----------------------------------------------------------------------------- */

/* docs/reference/event_file.md: t in integer microseconds, x right, y down, p 1 = brighter. */
typedef struct pecs_event {
  int64_t t_us;
  uint16_t x, y;
  uint8_t p;
  uint8_t unused[3];
} pecs_event;

/* [{"name": "evt3", "description": .., "extensions": [".raw"], "reads": true, "writes": true}, ...] */
PECS_API char* pecs_event_formats(pecs_error* error);

typedef struct pecs_event_reader pecs_event_reader;
/* options_json: {"format": a name of the list above (default: found from the content), "time_unit": "s" | "ms" | "us" |
 * "ns" and "width", "height" of a file that does not state them, "late": "sort" | "drop" events that are earlier than
 * one before them}; all may be left out, NULL: none. */
PECS_API pecs_event_reader* pecs_event_reader_open(const char* path, const char* options_json, pecs_error* error);
/* {"format": .., "width": .., "height": .., "camera": .., "late_events": number so far, with "late"}; width and height
 * are 0 for a file that does not say, until all events are read. */
PECS_API char* pecs_event_reader_info(const pecs_event_reader* reader, pecs_error* error);
/* Reads at most `capacity` events into `out`; returns how many: 0 only at the end. */
PECS_API int64_t pecs_event_reader_read(pecs_event_reader* reader, pecs_event* out, int64_t capacity,
                                        pecs_error* error);
PECS_API void pecs_event_reader_close(pecs_event_reader* reader);

typedef struct pecs_event_writer pecs_event_writer;
/* options: {"width": w, "height": h, "camera": "", "format": null | name (null: from the extension)}. */
PECS_API pecs_event_writer* pecs_event_writer_create(const char* path, const char* options_json, pecs_error* error);
/* Events sorted by t_us. */
PECS_API int pecs_event_writer_write(pecs_event_writer* writer, const pecs_event* events, int64_t count,
                                     pecs_error* error);
/* Completes the file: it appears under its name now. */
PECS_API int pecs_event_writer_finish(pecs_event_writer* writer, pecs_error* error);
/* A file that was not finished stays as <path>.partial. */
PECS_API void pecs_event_writer_close(pecs_event_writer* writer);

/* Events of a window as planes of float, for networks (formulas: pecs/events/representations.h). Events before begin_us
 * or after end_us do not count; all of `out` is filled, in the caller's thread. out: [bins][height][width], a voxel
 * grid that is bilinear in time; normalise: its values that are not 0 get mean 0 and standard deviation 1. */
PECS_API int pecs_voxel_grid(const pecs_event* events, int64_t count, int width, int height, int bins, double begin_us,
                             double end_us, int normalise, float* out, int64_t capacity, pecs_error* error);
/* out: [2][height][width], OFF and ON: exp(-(end_us - t) / tau_us) of each pixel's last event, 0 without one. */
PECS_API int pecs_time_surface(const pecs_event* events, int64_t count, int width, int height, double begin_us,
                               double end_us, double tau_us, float* out, int64_t capacity, pecs_error* error);
/* out: [2 * bins][height][width]: counts, all bins in time of OFF, then all of ON. */
PECS_API int pecs_event_histogram(const pecs_event* events, int64_t count, int width, int height, int bins,
                                  double begin_us, double end_us, float* out, int64_t capacity, pecs_error* error);

/* The picture that `pecs view` draws: out[height][width][3], 8 bits of R, G, B. theme: "light" or "dark". */
PECS_API int pecs_event_picture(const pecs_event* events, int64_t count, int width, int height, const char* theme,
                                uint8_t* out, int64_t capacity, pecs_error* error);

/* ---- chips and pixel models (sensor) --------------------------------------------------------------------------- */

/* [{"name": "esim", "source": the paper or page, "takes_light": false (grey values then, 1 is white),
 * "tells_causes": false (labels), "parameters": [{"key", "unit", "value": default, "min", "max", "meaning"}, ...]},
 * ...]. The parameters of `pecs` are the chip's. */
PECS_API char* pecs_models(pecs_error* error);
/* Published settings of other simulators, for the option "preset": [{"name", "description", "source", "model", "set":
 * {key: value} of the chip, "param": {key: value} of the model}, ...]. */
PECS_API char* pecs_presets(pecs_error* error);

typedef struct pecs_chip pecs_chip;
/* overrides_json: {"contrast_threshold_on": 0.25, ...} within the profile's ranges, or NULL. */
PECS_API pecs_chip* pecs_chip_open(const char* path_or_name, const char* overrides_json, pecs_error* error);
/* {"name", "description", "values": {key: {"value", "unit", "range": [min, max]}}, "relative_qe": {"lambda_nm": [...],
 * "value": [...]}} */
PECS_API char* pecs_chip_info(const pecs_chip* chip, pecs_error* error);
/* Amperes in a pixel per unit of each band's value. options: {"bands": [{"lambda_nm", "weight_nm"}, ...], "quantity":
 * "irradiance" | "radiance" | "relative", "fnumber": of the lens, for radiance, "gain" and "photocurrent_a": for
 * relative light, as in `pecs sense`}. result: {"amperes_per_unit": [per band]}. */
PECS_API char* pecs_chip_amperes_per_unit(const pecs_chip* chip, const char* options_json, pecs_error* error);
/* The photocurrent [A] of a stack's frame: out_a[height][width]. options: {"fnumber", "gain", "photocurrent_a"} as
 * above. Negative light gives 0, what is not finite gives NaN. Returns the number of pixels. */
PECS_API int64_t pecs_chip_photocurrent(const pecs_chip* chip, const pecs_stack_reader* stack, const char* options_json,
                                        int64_t frame, float* out_a, int64_t capacity, pecs_error* error);
PECS_API void pecs_chip_close(pecs_chip* chip);

/* The light of a stack on one chip or several (the colours of a camera), at any time: as `pecs sense` gives it to the
 * pixels, carried along the stack's motion between its frames. Holds frames of two intervals: cheapest for rising
 * times. t_us counts from the first frame; with a period it repeats without end. */
typedef struct pecs_light pecs_light;
/* options: {"chips": [{"chip": name | path, "set": {key: value}}, ...], "fnumber", "gain", "photocurrent_a": as above,
 * "fps": of a folder without stack.json, "motion": true (false: frames are blended at the pixel), "threads": 0}. */
PECS_API pecs_light* pecs_light_open(const char* stack, const char* options_json, pecs_error* error);
/* {"chips": how many, "width", "height", "motion": whether along it, "end_us": of the last frame | null (a period)} */
PECS_API char* pecs_light_info(const pecs_light* light, pecs_error* error);
/* Photocurrent [A] at each of `count` times: out_a[count][chips][height][width]. At a frame's time (to 0.5 ns) as
 * pecs_chip_photocurrent of that frame (with subpixels: to rounding). Returns how many values. */
PECS_API int64_t pecs_light_at(pecs_light* light, const double* t_us, int64_t count, float* out_a, int64_t capacity,
                               pecs_error* error);
/* Its mean over an exposure: out_a[chips][height][width]. Row y is exposed from begin_us + y * row_delay_us on (0: a
 * global shutter). The exposure is cut into `steps` equal cells, each with the light of its middle; 0: so many that
 * nothing moves more than half a pixel from one to the next, and more than the pictures between two frames (without
 * motion: four per interval). With a row delay the cells begin at begin_us, and those at the ends of a row's exposure
 * count in part; all rows together may have 2^20 cells. Returns how many values. */
PECS_API int64_t pecs_light_exposure(pecs_light* light, double begin_us, double exposure_us, double row_delay_us,
                                     int64_t steps, float* out_a, int64_t capacity, pecs_error* error);
PECS_API void pecs_light_close(pecs_light* light);

/* ---- the sensor (sensor) --------------------------------------------------------------------------------------- */

/* A pixel model of the caller's. Its functions are called one at a time, frame by frame, by the thread that pushes or
 * by one of the library's; what they return is checked. They must not throw. */
typedef struct pecs_model {
  int takes_light;  /* planes are photocurrent [A]; 0: grey values from 0 to 255 (white) */
  int tells_causes; /* events have causes: "labels" may be asked for */
  void* user;
  /* A state of its own for each simulation; NULL: failed. setup_json: {"width", "height", "seed", "chip": as in
   * pecs_chip_info without ranges, "parameters": the option "param"}. */
  void* (*begin)(const char* setup_json, void* user);
  /* One interval. planes: [2][height][width], the light at its begin and end; t_us: both times. events: is pointed to
   * [count][5] numbers t_us, x, y, p (1: ON, 0: OFF) and cause (as in pecs_sensor_labels; 0 without tells_causes), in
   * any order, from the interval's begin to 10 ms after its end, valid until the next call. Returns count; -1: failed,
   * and so does the call that simulates. */
  int64_t (*interval)(void* state, const float* planes, const double* t_us, const double** events);
  void (*end)(void* state); /* frees the state; may be NULL */
} pecs_model;

/* Called now and then with the share of the work that is done, from 0 to 1, by any thread. 0 stops the work, which then
 * fails with code 130; anything else goes on. */
typedef int (*pecs_progress_fn)(double done, void* user);

/* A stack in, an event file and its run record out, as `pecs sense` does. options: the program's long options with '_'
 * for '-' (docs/reference/sensor.md): {"chip": "imx636" | path, "set": {"key": value, ...}, "no_noise": false, "seed":
 * 1, "threads": 0 (all), "preset", "model": "pecs", "param": {"key": value, ...}, "white_a", "readout": "chip" |
 * "ideal", "format", "fps", "times_us": path, "photocurrent_a", "fnumber", "gain", "bands": "all" | "mc:N", "labels":
 * path, "warmup_loops": 0, "warmup_us": 0, "start_us": 0, "duration_us", "motion": true, "render_noise": 1}. model:
 * NULL, or one of the caller's; "model" is then its name in messages and records. progress: NULL, or called with
 * `user`. result: {"config": resolved, "results": counts, rates, light, "warnings": [lines]}. */
PECS_API char* pecs_sense(const char* input, const char* output, const char* options_json, const pecs_model* model,
                          pecs_progress_fn progress, void* user, pecs_error* error);

/* The motion between two keyframes (docs/reference/sensor.md), prepared for any number of instants. motion:
 * [channels][height][width], the 20 channels of the layer `motion` (docs/reference/exr_stack.md), or 2 (forward optical
 * flow in pixels) or 4 (forward and backward), NaN where not known. Threads may share it. */
typedef struct pecs_carrier pecs_carrier;
PECS_API pecs_carrier* pecs_carrier_open(const float* motion, int channels, int width, int height, pecs_error* error);
/* The light of both keyframes, prepared for any number of instants. first, second: [bands][height][width], any positive
 * light, which must outlive it. Threads may share it. */
typedef struct pecs_carried pecs_carried;
PECS_API pecs_carried* pecs_carried_open(const pecs_carrier* carrier, const float* first, const float* second,
                                         int bands, pecs_error* error);
/* Light at a fraction, 0 (the first keyframe) to 1. side: NULL or "both"; "first" or "second": what that keyframe alone
 * predicts, NaN where it does not show it. boxes: NULL for the whole picture, or `count` times left, top, right, bottom
 * [pixels]; light outside them is unspecified. out: [bands][height][width]. capacity: of out, in floats. */
PECS_API int pecs_carried_at(const pecs_carried* light, double fraction, const char* side, const int32_t* boxes,
                             int count, float* out, int64_t capacity, pecs_error* error);
PECS_API void pecs_carried_close(pecs_carried* light);
/* Numbers of what is seen (object ids) between two planes of them, [height][width]: each pixel gets that of the surface
 * point which is visible there at `fraction`, never blended. What neither plane shows is what both have at the pixel,
 * or 0. capacity: of out. */
PECS_API int pecs_carrier_labels(const pecs_carrier* carrier, const int32_t* first, const int32_t* second,
                                 double fraction, int32_t* out, int64_t capacity, pecs_error* error);
PECS_API void pecs_carrier_close(pecs_carrier* carrier);

/* The number of each event, at the event's own time (to half a pixel of motion), in a stack's layer of one channel of
 * whole numbers per instant ("objects"), along the stack's motion; 0 outside the stack's time. Events in the order of
 * time; begin_us: their time at the stack's first instant. The stack needs no light. Returns count. */
PECS_API int64_t pecs_event_labels(const pecs_event* events, int64_t count, const pecs_stack_reader* stack,
                                   const char* layer, double begin_us, uint16_t* out, int64_t capacity,
                                   pecs_error* error);

typedef struct pecs_sensor pecs_sensor;
/* Frames in memory. options: {"width": w, "height": h, "photocurrent_a": amperes for a value of 1, "labels": false,
 * "chip_frames": false} and "chip", "set", "no_noise", "seed", "threads", "preset", "model", "param", "readout" as in
 * pecs_sense. model: as in pecs_sense; its functions must outlive the sensor. */
PECS_API pecs_sensor* pecs_sensor_open(const char* options_json, const pecs_model* model, pecs_error* error);
/* frames: [count][height][width], linear light; t_us: their times, rising from push to push. An interval's events come
 * with the second frame after it, or when `last` says that no frame follows. Negative light is taken as 0; a pixel
 * whose value is not finite keeps its last one. Returns how many events there are. */
PECS_API int64_t pecs_sensor_push(pecs_sensor* sensor, const float* frames, const double* t_us, int64_t count, int last,
                                  pecs_error* error);
/* The same where it is known how things moved in the interval before each frame: motion is [count][channels][height]
 * [width], channels as in pecs_carrier_open; that of the first frame ever is not looked at. Light between the frames is
 * carried along it, so often that nothing moves more than half a pixel. */
PECS_API int64_t pecs_sensor_push_moving(pecs_sensor* sensor, const float* frames, const double* t_us, int64_t count,
                                         const float* motion, int channels, int last, pecs_error* error);
/* Copies the events of the last push, sorted by time, then row, then column. Returns how many; `capacity` must hold
 * them. */
PECS_API int64_t pecs_sensor_events(const pecs_sensor* sensor, pecs_event* out, int64_t capacity, pecs_error* error);
/* With "labels": the cause of each of them: 0 signal, 1 leak, 2 noise, 3 hot pixel, 6 chip_frames. */
PECS_API int64_t pecs_sensor_labels(const pecs_sensor* sensor, uint8_t* out, int64_t capacity, pecs_error* error);
/* With "chip_frames": frames of a DAVIS that the last push completed. values: [count][height][width], below 2^bits;
 * exposures_us: [count][2], begin and end (of the middle row). Returns how many; copies as many as `capacity` allows.
 */
PECS_API int64_t pecs_sensor_frames(const pecs_sensor* sensor, uint16_t* values, int64_t* exposures_us, int* bits,
                                    int64_t capacity, pecs_error* error);
/* Events lost so far because their pixel still waited to be read. */
PECS_API int64_t pecs_sensor_dropped(const pecs_sensor* sensor, pecs_error* error);
/* Events that each digital stage dropped so far: {"roi": N, "mask": N, "afk": N, "trail": N, "erc": N}. */
PECS_API char* pecs_sensor_dropped_by_stage(const pecs_sensor* sensor, pecs_error* error);
/* Values so far that no light has. Either pointer may be NULL. */
PECS_API int pecs_sensor_bad_values(const pecs_sensor* sensor, int64_t* not_finite, int64_t* negative,
                                    pecs_error* error);
PECS_API void pecs_sensor_close(pecs_sensor* sensor);

/* ---- comparison (calibration) --------------------------------------------------------------------------------- */

/* Distances and summaries (docs/reference/metrics.md). options: {"width": pixels, "height": pixels, "sim_width":
 * null | pixels, "sim_height": null | pixels (of `sim`; null: as `real`), "normalisation": "shared" | "eq16" | "paper",
 * "window_us": null | integer, "origin": "first-event" | "zero", "split_half": true, "seed": 1, "disk": null | what
 * `pecs align detect --json` prints, "realism": false}.
 * result: as printed by `pecs compare --json`. */
PECS_API char* pecs_compare(const pecs_event* real, int64_t real_count, const pecs_event* sim, int64_t sim_count,
                            const char* options_json, pecs_error* error);

/* Delays of one stream's events behind the edges of a turning disk (docs/reference/metrics.md). Events in time order.
 * options:
 * {"width": pixels, "height": pixels, "duration_us": the events lie in [0, this), "disk": what `pecs align detect
 * --json` prints}. result: as "delays" of pecs_compare, for one stream, and by regions of the disk. */
PECS_API char* pecs_delays(const pecs_event* events, int64_t count, const char* options_json, pecs_error* error);

/* A report as one HTML file, of blocks (calibration/page/include/pecs/page/page.h). */
PECS_API char* pecs_page(const char* page_json, pecs_error* error);

#ifdef __cplusplus
}
#endif
#endif
