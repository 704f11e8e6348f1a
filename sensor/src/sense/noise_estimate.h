#pragma once
// How many events of a run would not come again: in another render of the same scene, and in another recording of the
// same light. Both are simulated along with the run, and matched by Repeats.
#include <optional>

#include "pecs/sensor/photocurrent.h"
#include "pecs/sensor/sensor.h"
#include "sense/repeats.h"

namespace pecs::sensor {

// Pixels, and the order of their events.
struct Simulation {
  PixelArray pixels;
  EventSorter sorter;
  // Appends the events before final_us.
  void step(const FrameBatch& frames, PixelRange range, std::int64_t final_us, LabelledEvents& events);
};

class NoiseEstimate {
 public:
  // source, response, noise: arguments of PhotocurrentReader, whose noise is that between two renders. other_recording:
  // has other noise; none of models without a separate seed of it.
  NoiseEstimate(const FrameSource& source, const Response& response, double noise, Simulation other_render,
                std::optional<Simulation> other_recording, const Repeats& repeats);
  PhotocurrentReader& light() { return light_; }
  // frames: of the run; light: planes of light(). Labels the run's events as Cause::render, and holds those back whose
  // partners are not yet known.
  void step(FrameBatch frames, const std::vector<const float*>& light, PixelRange range, std::int64_t final_us,
            LabelledEvents& events);
  void report(Json& results) const;  // shares and, where much is the renderer's, a warning

 private:
  struct Other {
    Simulation simulation;
    Repeats repeats;
    LabelledEvents events{};
  };
  static void match(Other& other, const FrameBatch& frames, PixelRange range, std::int64_t final_us,
                    LabelledEvents& events);

  PhotocurrentReader light_;
  Other other_render_;
  std::optional<Other> other_recording_;
};

}  // namespace pecs::sensor
