// ICNS: Joubert, Marcireau, Ralph, Jolley, van Schaik, Cohen, "Event Camera Simulator Improvements via Characterized
// Parameters", Frontiers in Neuroscience 2021 (with its constant-frequency background noise). A frame is a step of
// light at its interval's start; the pixel's voltage relaxes to its logarithm exponentially, with a time constant that
// decreases with light. Uses the chip's thresholds, mismatch (redrawn after each event), refractory period and
// background rates.
#include <algorithm>
#include <limits>

#include "models/frame_by_frame.h"
#include "pecs/sensor/random.h"

namespace pecs::sensor {
namespace {

constexpr ModelParameter kIcnsParameters[] = {
    {"white_lux", "lux", 1e4, 1, 1e7, "light of grey value 255"},
    {"tau_us", "us", 40, 0, 1e6, "time constant at 1 klux"},
    {"latency_us", "us", 100, 0, 1e4, "of the readout, mean"},
    {"jitter_us", "us", 10, 0, 1e4, "of the latency"},
};

constexpr double kNever = std::numeric_limits<double>::infinity();

class Icns : public PixelModel {
 public:
  explicit Icns(const ModelSetup& s)
      : lux_per_unit_(s.per_unit / 255 * s.at("white_lux")),
        tau_us_(s.at("tau_us")),
        latency_us_(s.at("latency_us")),
        jitter_us_(s.at("jitter_us")),
        refractory_us_(s.chip.refractory_period_s * 1e6),
        on_(s.chip.contrast_threshold_on),
        off_(s.chip.contrast_threshold_off),
        mismatch_(s.chip.threshold_mismatch),
        period_on_us_(s.chip.background_on_hz > 0 ? 1e6 / s.chip.background_on_hz : kNever),
        period_off_us_(s.chip.background_off_hz > 0 ? 1e6 / s.chip.background_off_hz : kNever),
        seed_(s.seed),
        pixels_(s.pixels()) {
    for (std::size_t i = 0; i < pixels_.size(); ++i) {
      const Random4 r = random4(seed_, static_cast<std::uint32_t>(i), 0, Purpose::threshold);
      Pixel& p = pixels_[i];
      p.on = std::max(0.0, on_ * (1 + mismatch_ * gaussian(r[0])));
      p.off = std::max(0.0, off_ * (1 + mismatch_ * gaussian(r[1])));
      p.noise_on_us = period_on_us_ * uniform(r[2]);
      p.noise_off_us = period_off_us_ * uniform(r[3]);
    }
  }

  void advance(const FrameBatch& batch, PixelRange range, EventSlots& events) override {
    each_frame(
        batch, range, lux_per_unit_,
        [&](std::uint32_t k, const FramePlane& frame) {
          Pixel& p = pixels_[k];
          p.v = p.reference = std::log(1.0 + (p.lux = frame.grey(k, 0)));
        },
        [&](std::uint32_t k, const FramePlane& frame, const FrameInterval& t) {
          Pixel& p = pixels_[k];
          p.lux = frame.grey(k, p.lux);
          step(p, k, t, events);
        });
  }

 private:
  struct Pixel {
    float lux = 0;
    double v = 0, reference = 0;  // voltage, and its value at the last reset
    double on = 0, off = 0;
    double blind_until_us = kNever;  // end of a running refractory period
    double noise_on_us = kNever, noise_off_us = kNever;
  };

  void step(Pixel& p, std::uint32_t pixel, const FrameInterval& t, EventSlots& events) {
    const double light = std::log(1.0 + p.lux), tau = tau_us_ * 1e3 / (p.lux + 1);
    double from_us = t.begin_us;
    // If the refractory period ends within the interval, the reference becomes the voltage at its end.
    const auto see_again = [&] {
      if (!(p.blind_until_us < t.end_us)) return false;
      p.v = relaxed(p.v, light, p.blind_until_us - from_us, tau);
      from_us = p.blind_until_us;
      p.reference = p.v;
      p.blind_until_us = kNever;
      return true;
    };
    see_again();
    for (const bool on : {true, false}) {
      double& next = on ? p.noise_on_us : p.noise_off_us;
      if (!(next < t.end_us)) continue;
      events.add(event_key(static_cast<std::int64_t>(next), pixel, on));
      from_us = next;
      next += on ? period_on_us_ : period_off_us_;
      p.v = p.reference = light;
    }

    for (std::int64_t draw = 0; p.blind_until_us == kNever; ++draw) {
      const double change = relaxed(p.v, light, t.end_us - from_us, tau) - p.reference;
      const bool on = change > p.on;
      if (!on && !(change < -p.off)) break;
      const double level = p.reference + (on ? p.on : -p.off);
      const Random4 r = random4(seed_, pixel, t.index << 20 | draw, Purpose::model);
      double delay_us = latency_us_ - tau * std::log1p(-(level - p.v) / (light - p.v));
      const double threshold_noise_us = mismatch_ * (on ? on_ : off_) * tau / (light - p.v);
      delay_us += std::hypot(jitter_us_, threshold_noise_us) * gaussian(r[0]);
      delay_us = std::floor(std::clamp(delay_us, 0.0, 1e4));  // whole us
      events.add(event_key(static_cast<std::int64_t>(from_us + delay_us), pixel, on));
      double& threshold = on ? p.on : p.off;
      threshold = std::max(0.0, (on ? on_ : off_) * (1 + mismatch_ * gaussian(r[1])));
      p.blind_until_us = from_us + std::max(delay_us + refractory_us_, 1.0);
      if (!see_again()) break;
    }
    p.v = relaxed(p.v, light, t.end_us - from_us, tau);
  }

  static double relaxed(double v, double target, double dt_us, double tau_us) {
    return tau_us > 0 ? v - (target - v) * std::expm1(-dt_us / tau_us) : target;
  }

  double lux_per_unit_, tau_us_, latency_us_, jitter_us_, refractory_us_, on_, off_, mismatch_, period_on_us_,
      period_off_us_;
  std::uint64_t seed_;
  std::vector<Pixel> pixels_;
};

}  // namespace

extern const ModelEntry kModel_icns{
    "icns", "Joubert et al., Frontiers in Neuroscience 2021", kIcnsParameters, {}, make_model<Icns>};

}  // namespace pecs::sensor
