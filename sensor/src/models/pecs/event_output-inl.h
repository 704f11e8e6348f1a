// Events of a block of pixels, with their causes. Included once per instruction set.
#if defined(PECS_EVENT_OUTPUT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef PECS_EVENT_OUTPUT_INL_H_
#undef PECS_EVENT_OUTPUT_INL_H_
#else
#define PECS_EVENT_OUTPUT_INL_H_
#endif

#include "models/pecs/active_lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::sensor::HWY_NAMESPACE {

class EventOutput {
 public:
  EventOutput(const KernelArguments& a, const BlockRows& rows) : a_(a), rows_(rows) {}

  void begin(const IntervalTimes& t) { clock_ = Clock(t); }
  // The noise at pixels' resets, for causes.
  void mark(const IntervalTimes& t, const ActiveLanes& g, M which, V s, V noise) {
    if (!a_.marks) return;
    HWY_ALIGN float at_s[kLanes], of_noise[kLanes];
    set(at_s, s);
    set(of_noise, noise);
    each(which, [&](std::size_t k) {
      ResetMark& mark = a_.marks[rows_.first + g.pixels[k]];
      mark.t_us = t.t0_us + double{at_s[k]} * t.h_us, mark.noise = of_noise[k], mark.phase = 0;
      if (mark.t_us > mark.step_us) mark.step = mark.slow = 0;
    });
  }

  Cause cause(double t_us, std::uint32_t p, float noise_now, bool on, float reference) const {
    const ResetMark& mark = a_.marks[rows_.first + p];
    const double sign = on ? 1 : -1;
    const double noise = sign * double{noise_now - mark.noise};
    const double leaked = sign * a_.constants.leak_per_us * (t_us - mark.t_us);
    const double threshold = on ? rows_.on[p] : rows_.off[p];
    // The rest of an exposure's step, against all else since.
    const double since_us = t_us - mark.step_us;
    const PixelConstants& c = a_.constants;
    const double relaxed = since_us * (c.b_per_us > 0 ? c.b_per_us : c.a_per_us * rows_.i[0][p]);
    const double stepped =
        sign * (mark.step * std::exp(-relaxed) + mark.slow * std::exp(-since_us / a_.exposures.slow_us));
    const double moved = threshold - sign * double{mark.output - reference};
    if (stepped > 0 && since_us >= 0 && 2 * stepped > moved) return Cause::frame;
    const double signal = threshold - noise - leaked - sign * double{mark.phase};
    return signal >= std::max(noise, leaked) ? Cause::signal : leaked > noise ? Cause::leak : Cause::noise;
  }

  HWY_INLINE void emit(const IntervalTimes& t, const ActiveLanes& g, M fires, M by_noise, V s, V noise) {
    const U32 u;
    const Compress compress(fires);
    const VU on = hn::IfThenElseZero(hn::RebindMask(u, holds(g.next_on)), hn::Set(u, 1u << kKeyOnShift));
    const VU pixels = hn::Add(hn::Load(u, g.pixels), hn::Set(u, rows_.first));
    compress.store(clock_.us(s), us_ + fired_);
    compress.store(hn::Or(hn::ShiftLeft<kKeyPixelShift>(pixels), on), place_ + fired_);
    if (a_.marks) {
      HWY_ALIGN float at_s[kLanes], of_noise[kLanes], background[kLanes];
      set(at_s, s);
      set(of_noise, noise);
      set(background, by_noise);
      std::uint32_t* place = place_ + fired_;
      each(fires, [&](std::size_t k) {
        const std::uint32_t p = g.pixels[k];
        const double t_us = t.t0_us + double{at_s[k]} * t.h_us;
        const Cause why =
            background[k] > 0 ? background_cause[p] : cause(t_us, p, of_noise[k], g.next_on[k] > 0, g.reference[k]);
        *place++ |= static_cast<std::uint32_t>(why);
      });
    }
    fired_ += compress.count();
    if (fired_ > kRoom) flush();
  }
  void flush() {
    clock_.add(us_, place_, fired_, *a_.events);
    fired_ = 0;
  }

  Cause background_cause[BlockRows::kPixels];  // of the next background event

 private:
  const KernelArguments& a_;
  const BlockRows& rows_;
  Clock clock_;            // of the interval
  std::size_t fired_ = 0;  // events in us_ and place_
  std::int32_t us_[kRoom + 2 * kLanes];
  std::uint32_t place_[kRoom + 2 * kLanes];
};

}  // namespace pecs::sensor::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif
