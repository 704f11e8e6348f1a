/* Frames in memory to events, in C: a bright bar moves over a dark wall.
 *
 * simulate_frames OUTPUT [CHIP]      OUTPUT: bar.raw (EVT3), or .npz, .hdf5, .aedat4, .csv, ...; CHIP: imx636 */
#include <pecs.h>
#include <stdio.h>
#include <stdlib.h>

enum { kWidth = 320, kHeight = 240, kFrames = 60 };

/* Every function of PECS tells what went wrong in one line; its code is the exit code. */
static void check(int good, const pecs_error* error) {
  if (good) return;
  fprintf(stderr, "simulate_frames: %s\n", error->message);
  exit(error->code);
}

/* Linear light, 1 is white; the bar's edges are smooth over a pixel and it moves 0.8 pixels a frame. */
static void draw_bar(float* pixels, int frame) {
  const double left = 40 + 0.8 * frame, right = left + 60;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      const double from = x > left ? x : left, to = x + 1 < right ? x + 1 : right;
      pixels[y * kWidth + x] = (float)(0.1 + 0.7 * (to > from ? to - from : 0));
    }
}

int main(int argc, char** argv) {
  static float pixels[kWidth * kHeight];
  pecs_error error;
  char options[512];
  if (argc < 2) {
    fprintf(stderr, "usage: simulate_frames OUTPUT [CHIP]\n");
    return 2;
  }
  snprintf(options, sizeof options, "{\"width\": %d, \"height\": %d, \"chip\": \"%s\", \"photocurrent_a\": 1e-12}",
           kWidth, kHeight, argc > 2 ? argv[2] : "imx636");
  pecs_sensor* sensor = pecs_sensor_open(options, NULL, &error);
  check(sensor != NULL, &error);
  snprintf(options, sizeof options, "{\"width\": %d, \"height\": %d}", kWidth, kHeight);
  pecs_event_writer* writer = pecs_event_writer_create(argv[1], options, &error);
  check(writer != NULL, &error);

  int64_t total = 0, capacity = 0;
  pecs_event* events = NULL;
  for (int i = 0; i < kFrames; ++i) {
    const double t_us = 1000.0 * i;
    draw_bar(pixels, i);
    const int64_t count = pecs_sensor_push(sensor, pixels, &t_us, 1, i + 1 == kFrames, &error);
    check(count >= 0, &error);
    if (count > capacity) {
      capacity = 2 * count;
      free(events);
      events = malloc((size_t)capacity * sizeof *events);
      if (!events) return 1;
    }
    check(pecs_sensor_events(sensor, events, capacity, &error) == count, &error);
    check(pecs_event_writer_write(writer, events, count, &error) == 0, &error);
    total += count;
  }
  check(pecs_event_writer_finish(writer, &error) == 0, &error);
  printf("%lld events in %s, by PECS %s\n", (long long)total, argv[1], pecs_version());
  free(events);
  pecs_event_writer_close(writer);
  pecs_sensor_close(sensor);
  return 0;
}
