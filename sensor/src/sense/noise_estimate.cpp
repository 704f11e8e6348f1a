#include "sense/noise_estimate.h"

#include <fmt/format.h>

#include <algorithm>

namespace pecs::sensor {
namespace {

constexpr double kMuchRenderNoise = 0.1;  // share of the events; more is a warning

}  // namespace

void Simulation::step(const FrameBatch& frames, PixelRange range, std::int64_t final_us, LabelledEvents& events) {
  sorter.begin(frames.t_us);
  pixels.advance(frames, range, sorter);
  sorter.take(final_us, events);
}

NoiseEstimate::NoiseEstimate(const FrameSource& source, const Response& response, double noise, Simulation other_render,
                             std::optional<Simulation> other_recording, const Repeats& repeats)
    : light_(source, response, noise), other_render_{std::move(other_render), repeats} {
  if (other_recording) other_recording_ = Other{std::move(*other_recording), repeats};
}

void NoiseEstimate::match(Other& other, const FrameBatch& frames, PixelRange range, std::int64_t final_us,
                          LabelledEvents& events) {
  other.simulation.step(frames, range, final_us, other.events);
  other.repeats.match(events, other.events, final_us, frames.last);
}

void NoiseEstimate::step(FrameBatch frames, const std::vector<const float*>& light, PixelRange range,
                         std::int64_t final_us, LabelledEvents& events) {
  if (other_recording_) {
    LabelledEvents same = events;
    match(*other_recording_, frames, range, final_us, same);
  }
  frames.planes = light;
  match(other_render_, frames, range, final_us, events);
}

void NoiseEstimate::report(Json& results) const {
  results["render_noise"] = other_render_.repeats.report();
  std::string camera;
  double limit = kMuchRenderNoise;
  if (other_recording_) {
    results["camera_noise"] = other_recording_->repeats.report();
    limit = std::max(limit, other_recording_->repeats.share());
    camera = fmt::format("; from the camera's own noise: {:.0f} %", 100 * other_recording_->repeats.share());
  }
  if (const double share = other_render_.repeats.share(); share > limit)
    results["warnings"].push_back(fmt::format(
        "{:.0f} % of the events come from the noise of the renderer (they would not come again in another render{}); "
        "render with more --samples, or with --noise-events 10%",
        100 * share, camera));
}

}  // namespace pecs::sensor
