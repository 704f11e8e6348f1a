// ESIM: Rebecq, Gehrig, Scaramuzza, "ESIM: an open event camera simulator", CoRL 2018. The logarithm of the picture
// is linear between frames; an event fires wherever it has changed by a threshold since the last one (Sec. 3.1). Uses
// the chip's thresholds and refractory period.
#include "light/float_math.h"
#include "models/frame_by_frame.h"

namespace pecs::sensor {
namespace {

constexpr ModelParameter kEsimParameters[] = {
    {"log_eps", "1", 1e-3, 1e-9, 1, "added to the picture (white = 1) before the logarithm"},
};

class Esim : public PixelModel {
 public:
  explicit Esim(const ModelSetup& s)
      : grey_per_unit_(s.per_unit),
        log_eps_(static_cast<float>(s.at("log_eps"))),
        on_(static_cast<float>(s.chip.contrast_threshold_on)),
        off_(static_cast<float>(s.chip.contrast_threshold_off)),
        refractory_us_(s.chip.refractory_period_s * 1e6),
        pixels_(s.pixels()) {}

  void advance(const FrameBatch& batch, PixelRange range, EventSlots& events) override {
    each_frame(
        batch, range, grey_per_unit_,
        [&](std::uint32_t k, const FramePlane& frame) {
          Pixel& p = pixels_[k];
          p.log = p.reference = log_grey(p.grey = frame.grey(k, 0));
        },
        [&](std::uint32_t k, const FramePlane& frame, const FrameInterval& t) {
          step(pixels_[k], k, frame, t, events);
        });
  }

 private:
  struct Pixel {
    float grey = 0, log = 0, reference = 0;
    double last_us = -1e300;
  };

  float log_grey(float grey) const { return log_of(grey / 255 + log_eps_); }

  void step(Pixel& p, std::uint32_t pixel, const FramePlane& frame, const FrameInterval& t, EventSlots& events) {
    const float grey = frame.grey(pixel, p.grey);
    if (grey == p.grey) return;
    const float log = log_grey(grey);
    const bool on = log > p.log;
    for (float next = p.reference + (on ? on_ : -off_); on ? next <= log : next >= log; next += on ? on_ : -off_) {
      const double t_us = t.begin_us + (t.end_us - t.begin_us) * static_cast<double>(next - p.log) / (log - p.log);
      if (t_us - p.last_us >= refractory_us_) {
        events.add(event_key(std::llround(t_us), pixel, on));
        p.last_us = t_us;
      }
      p.reference = next;
    }
    p.grey = grey;
    p.log = log;
  }

  double grey_per_unit_;
  float log_eps_, on_, off_;
  double refractory_us_;
  std::vector<Pixel> pixels_;
};

}  // namespace

extern const ModelEntry kModel_esim{
    "esim", "Rebecq, Gehrig, Scaramuzza, CoRL 2018", kEsimParameters, {.is_random = false}, make_model<Esim>};

}  // namespace pecs::sensor
