// v2e: Hu, Liu, Delbruck, "v2e: From Video Frames to Realistic DVS Events", CVPR Workshops 2021 (without its frame
// interpolation and photoreceptor-noise option). A frame's events lie on a grid of as many times as the busiest pixel
// has events; the last one is the frame's time.
// Uses the chip's thresholds, mismatch, refractory period and leak rate; background_on + background_off is the shot
// noise.
#include <algorithm>
#include <array>
#include <atomic>
#include <numbers>

#include "models/frame_by_frame.h"
#include "pecs/sensor/random.h"

namespace pecs::sensor {
namespace {

constexpr ModelParameter kV2eParameters[] = {
    {"linear_below", "grey", 20, 1, 255, "the logarithm is linear below this grey value (Sec. 3, lin-log)"},
    {"cutoff_hz", "Hz", 0, 0, 1e6, "photoreceptor's corner at white (0: none); falls with the grey value"},
    {"leak_jitter", "1", 0.1, 0, 10, "relative deviation of a frame's leak"},
    {"noise_rate_cov_decades", "1", 0.1, 0, 3, "of the log-normal spread of leak between pixels, decades"},
    {"shot_noise_dark_factor", "1", 0.25, 0, 10, "shot noise in white / in darkness"},
};

class V2e : public PixelModel {
 public:
  explicit V2e(const ModelSetup& s)
      : s_{s.per_unit,
           s.at("linear_below"),
           s.at("cutoff_hz"),
           s.at("leak_jitter"),
           s.at("shot_noise_dark_factor"),
           s.chip.leak_rate_hz,
           s.chip.background_on_hz + s.chip.background_off_hz,
           s.chip.refractory_period_s,
           s.chip.contrast_threshold_on,
           s.chip.contrast_threshold_off,
           s.seed},
        pixels_(s.pixels()) {
    const double decades = s.at("noise_rate_cov_decades") * std::numbers::ln10;
    for (std::size_t i = 0; i < pixels_.size(); ++i) {
      const Random4 r = random4(s.seed, static_cast<std::uint32_t>(i), 0, Purpose::threshold);
      const auto threshold = [&](double nominal, std::uint32_t word) {
        return s.chip.threshold_mismatch > 0
                   ? static_cast<float>(std::max(0.01, nominal * (1 + s.chip.threshold_mismatch * gaussian(word))))
                   : nominal;
      };
      Pixel& p = pixels_[i];
      p.on = threshold(s.chip.contrast_threshold_on, r[0]);
      p.off = threshold(s.chip.contrast_threshold_off, r[1]);
      p.leak = static_cast<float>(std::exp(decades * gaussian(r[2])));
      p.last_s = -s.chip.refractory_period_s;
    }
  }

  void survey(const FrameBatch& batch, PixelRange range) override {
    int busiest = 0;
    each_frame(
        batch, range, s_.grey_per_unit,
        [&](std::uint32_t k, const FramePlane& frame) {
          Pixel& p = pixels_[k];
          p.v = p.memory = lin_log(p.grey = frame.grey(k, 0));
        },
        [&](std::uint32_t k, const FramePlane& frame, const FrameInterval& t) {
          busiest = std::max(busiest, count(k, frame, (t.end_us - t.begin_us) * 1e-6, t.index));
        });
    std::atomic<int>& most = most_[batch.first_frame & 1];
    for (int seen = most; busiest > seen && !most.compare_exchange_weak(seen, busiest);) {
    }
  }

  void advance(const FrameBatch& batch, PixelRange range, EventSlots& events) override {
    const int steps = std::max(1, most_[batch.first_frame & 1].load());
    most_[~batch.first_frame & 1] = 0;  // of the next frame
    if (batch.first_frame == 0 || batch.planes.empty()) return;
    const FrameInterval t = interval_before(batch, 0);
    for (std::uint32_t k = range.first; k < range.end; ++k) emit(k, t, steps, events);
  }

 private:
  struct Settings {
    double grey_per_unit, linear_below, cutoff_hz, leak_jitter, dark_factor, leak_hz, shot_hz, refractory_s, on, off;
    std::uint64_t seed;
  };
  struct Pixel {
    float grey = 0, leak = 1;
    double on = 0, off = 0;
    double v = 0, memory = 0;  // photoreceptor's output, memorised at the last event
    double last_s = 0;
    int events = 0;  // threshold crossings of this frame; negative: OFF
  };

  // v2e computes in single precision, except in its low-pass filter. The precision decides ties, which are frequent in
  // 8-bit pictures that alternate.
  double rounded(double v) const { return s_.cutoff_hz > 0 ? v : static_cast<float>(v); }

  double lin_log(float grey) const {
    const double v = grey <= s_.linear_below ? grey * std::log(s_.linear_below) / s_.linear_below
                                             : std::log(static_cast<double>(grey));
    return static_cast<float>(std::round(v * 1e8) / 1e8);
  }

  // floor(a / b), exact near integers.
  int whole(double a, double b) const {
    if (s_.cutoff_hz > 0) return static_cast<int>(std::round((a - std::fmod(a, b)) / b));
    const auto x = static_cast<float>(a), y = static_cast<float>(b);
    return static_cast<int>(std::round((x - std::fmod(x, y)) / y));
  }

  int count(std::uint32_t pixel, const FramePlane& frame, double dt_s, std::int64_t step) {
    Pixel& p = pixels_[pixel];
    p.grey = frame.grey(pixel, p.grey);
    const double log = lin_log(p.grey);
    if (s_.cutoff_hz > 0) {
      const double eps = std::min(1.0, (p.grey + 20.0) / 275.0 * dt_s * 2 * std::numbers::pi * s_.cutoff_hz);
      p.v = (1 - eps) * p.v + eps * log;
    } else {
      p.v = log;
    }
    if (s_.leak_hz > 0) {
      const double jitter =
          s_.leak_jitter > 0 ? s_.leak_jitter * gaussian(random4(s_.seed, pixel, step, Purpose::model)[0]) : 0;
      p.memory = rounded(p.memory - dt_s * s_.leak_hz * p.leak * (1 - jitter) * p.on);
    }
    const double change = rounded(p.v - p.memory);
    p.events = change >= 0 ? whole(change, p.on) : -whole(-change, p.off);
    return std::abs(p.events);
  }

  void emit(std::uint32_t pixel, const FrameInterval& t, int steps, EventSlots& events) {
    Pixel& p = pixels_[pixel];
    const bool on = p.events > 0;
    const double spacing_us = (t.end_us - t.begin_us) / steps;
    int fired = 0;
    for (int i = 1; i <= std::abs(p.events); ++i) {
      const double t_us = t.begin_us + i * spacing_us;
      if (s_.refractory_s > spacing_us * 1e-6) {
        if (t_us * 1e-6 - p.last_s <= s_.refractory_s) continue;
        p.last_s = t_us * 1e-6;
      }
      events.add(event_key(std::llround(t_us), pixel, on));
      ++fired;
    }
    const float moved = static_cast<float>(fired) * static_cast<float>(on ? p.on : p.off);
    if (fired) p.memory = rounded(p.memory + (on ? moved : -moved));
    if (s_.shot_hz > 0) {
      const double white = (p.grey + 20.0) / 275.0;
      const double half =
          s_.shot_hz / 2 * (t.end_us - t.begin_us) * 1e-6 * ((s_.dark_factor - 1) * white + 1);  // of one polarity
      const double u = uniform(random4(s_.seed, pixel, t.index, Purpose::model)[1]);
      const bool noise_on = u > 1 - half * s_.on / p.on, noise_off = u < half * s_.off / p.off;
      if (noise_on || noise_off) {
        events.add(event_key(std::llround(t.end_us), pixel, noise_on));
        p.memory = p.v;
      }
    }
  }

  Settings s_;
  std::vector<Pixel> pixels_;
  std::array<std::atomic<int>, 2> most_{};  // events of the busiest pixel, of even and odd frames
};

}  // namespace

extern const ModelEntry kModel_v2e{"v2e",
                                   "Hu, Liu, Delbruck, CVPR Workshops 2021",
                                   kV2eParameters,
                                   {.pixels_are_independent = false},
                                   make_model<V2e>};

}  // namespace pecs::sensor
