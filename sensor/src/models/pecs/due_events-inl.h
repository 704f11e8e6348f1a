// What comes to pixels at given times: background events, and exposures of the chip's frames. Included once per
// instruction set.
#if defined(PECS_DUE_EVENTS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef PECS_DUE_EVENTS_INL_H_
#undef PECS_DUE_EVENTS_INL_H_
#else
#define PECS_DUE_EVENTS_INL_H_
#endif

#include <algorithm>
#include <cmath>
#include <span>

#include "models/pecs/event_output-inl.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::sensor::HWY_NAMESPACE {

// Times are s in the interval. When an exposure begins or ends, V steps. Only the distance of V from the reference
// counts, so that the reference moves instead, the other way.
class DueEvents {
 public:
  DueEvents(const KernelArguments& a, BlockRows& rows, EventOutput& output) : a_(a), rows_(rows), output_(output) {}

  // background: of these pixels, by time.
  void begin(std::span<const BackgroundEvent> background) {
    background_ = background;
    std::fill_n(background_s_, BlockRows::kPixels, kNone);
    std::fill_n(exposure_s_, BlockRows::kPixels, kNone);
    std::fill_n(next_step_, BlockRows::kPixels, 0u);
  }

  const float* background_s() const { return background_s_; }
  const float* exposure_s() const { return exposure_s_; }

  // Adds the pixels with due events in the interval to the `count` jobs; returns the number of all.
  std::size_t list(const IntervalTimes& t, std::uint32_t* jobs, std::size_t count) {
    const auto later = [&](const BackgroundEvent& e) { return e.t_us >= t.t1_us; };
    due_ = background_.first(static_cast<std::size_t>(std::ranges::find_if(background_, later) - background_.begin()));
    background_ = background_.subspan(due_.size());
    is_exposed_ = has_steps(t);
    if (due_.empty() && !is_exposed_) return count;
    std::uint8_t is_listed[BlockRows::kPixels] = {};
    for (std::size_t k = 0; k < count; ++k) is_listed[jobs[k]] = 1;
    const auto add = [&](std::uint32_t p) {
      if (!is_listed[p] || rows_.gate[p] != kFree) rows_.gate[p] = kNoGate;
      if (!is_listed[p]) jobs[count++] = p;
      is_listed[p] = 1;
    };
    for (const BackgroundEvent& e : due_) {
      const std::uint32_t p = e.pixel - rows_.first;
      if (background_s_[p] < kNone) continue;
      background_s_[p] = in_interval(e.t_us, t);
      add(p);
    }
    for (std::uint32_t p = 0; is_exposed_ && p < rows_.count; ++p) {
      while (next_step_[p] < a_.exposures.steps.size() && step_us(p) < t.t0_us) ++next_step_[p];
      exposure_s_[p] = step_s(p, t);
      if (exposure_s_[p] < kNone) add(p);
    }
    return count;
  }
  void end_interval() {
    for (const BackgroundEvent& e : due_) background_s_[e.pixel - rows_.first] = kNone;
    if (is_exposed_) std::fill_n(exposure_s_, rows_.count, kNone);
  }

  // A background event before the crossing found replaces it. Returns the lanes where it does.
  M background_first(const IntervalTimes& t, ActiveLanes& g, M seeking) {
    HWY_ALIGN float replaces[kLanes] = {};
    const BackgroundEvent* const none = due_.data() + due_.size();
    each(seeking, [&](std::size_t k) {
      const std::uint32_t p = g.pixels[k];
      const auto after = [&](const BackgroundEvent* e, float s) {  // the first at s or later
        while (e != none && (e->pixel != rows_.first + p || in_interval(e->t_us, t) < s)) ++e;
        return e;
      };
      const auto time_of_event = [&](const BackgroundEvent* e) { return e == none ? kNone : in_interval(e->t_us, t); };
      const float ds = g.s1[k] - g.s0[k], begin = g.s0[k] + ds * g.from[k], end = g.s0[k] + ds * g.to[k];
      const BackgroundEvent* e = after(due_.data(), std::max(g.background[k], begin));
      g.background[k] = time_of_event(e);
      const float at = (g.background[k] - begin) / (end - begin);
      if (g.background[k] >= end || at >= g.next[k]) return;
      g.next[k] = std::max(at, 0.0f);
      g.next_on[k] = e->on;
      replaces[k] = 1;
      output_.due_cause[p] = e->cause;
      g.background[k] = time_of_event(after(e + 1, 0));
    });
    return holds(replaces);
  }

  // Where an exposure's step, at u of the leaf, precedes crossing and background event, the reference moves. Pixels
  // that are then beyond a threshold fire, the others go on from u. v: V in the leaf.
  struct Stepped {
    M fires, goes_on;
    V u;
  };
  Stepped exposure_first(const IntervalTimes& t, ActiveLanes& g, M seeking, const Cubic<V>& v) {
    HWY_ALIGN float begin[kLanes], at_u[kLanes], at_v[kLanes], fires[kLanes] = {}, goes_on[kLanes] = {};
    const V begins = time_of(g, get(g.from)), length = hn::Sub(time_of(g, get(g.to)), begins);
    set(begin, begins);
    each(seeking, [&](std::size_t k) {
      while (g.exposure[k] < begin[k]) pass(t, g, k);  // the pixel was blind
    });
    const V u = hn::Div(hn::Sub(get(g.exposure), begins), length);
    set(at_u, u);
    set(at_v, v.at(u));
    each(seeking, [&](std::size_t k) {
      const std::uint32_t p = g.pixels[k];
      const bool after_noise = g.background[k] >= begin[k] && g.background[k] < g.exposure[k];
      if (at_u[k] >= 1 || at_u[k] >= g.next[k] || after_noise) return;
      const float step = step_of(p);
      pass(t, g, k);
      g.reference[k] -= step;
      if (a_.marks) a_.marks[rows_.first + p].frame += step;
      const float from_reference = at_v[k] - g.reference[k];
      const bool on = from_reference >= g.on[k];
      if (!on && from_reference > -g.off[k]) {
        goes_on[k] = 1;
        return;
      }
      g.next[k] = at_u[k];
      g.next_on[k] = on;
      fires[k] = 1;
      output_.due_cause[p] = Cause::frame;
    });
    return {holds(fires), holds(goes_on), u};
  }

 private:
  static constexpr float kNone = 2;  // no event: beyond s = 1

  static float in_interval(double t_us, const IntervalTimes& t) {
    return std::clamp(static_cast<float>((t_us - t.t0_us) / (t.t1_us - t.t0_us)), 0.0f, 0x1.fffffep-1f);
  }
  double delay_us(std::uint32_t p) const { return a_.exposures.row_us * ((rows_.first + p) / a_.exposures.width); }
  double step_us(std::uint32_t p) const { return a_.exposures.steps[next_step_[p]].t_us + delay_us(p); }
  bool has_steps(const IntervalTimes& t) const {
    return std::ranges::any_of(a_.exposures.steps, [&](const ExposureStep& step) {
      return step.t_us + delay_us(0) < t.t1_us && step.t_us + delay_us(rows_.count - 1) >= t.t0_us;
    });
  }
  float step_s(std::uint32_t p, const IntervalTimes& t) const {
    if (next_step_[p] == a_.exposures.steps.size() || step_us(p) >= t.t1_us) return kNone;
    return in_interval(step_us(p), t);
  }
  void pass(const IntervalTimes& t, ActiveLanes& g, std::size_t k) {
    ++next_step_[g.pixels[k]];
    g.exposure[k] = step_s(g.pixels[k], t);
  }
  // The next step of V: down at an exposure's begin, and back at its end.
  float step_of(std::uint32_t p) const {
    const ExposureStep& step = a_.exposures.steps[next_step_[p]];
    const Random4 r = random4(a_.noise_seed, rows_.first + p, step.frame, Purpose::exposure);
    const double size = a_.exposures.step * std::exp(a_.exposures.spread * sensor::gaussian(r[0]));
    return static_cast<float>(step.ends ? size : -size);
  }

  const KernelArguments& a_;
  BlockRows& rows_;
  EventOutput& output_;
  std::span<const BackgroundEvent> background_, due_;  // of later intervals; of this interval
  bool is_exposed_ = false;
  HWY_ALIGN float background_s_[BlockRows::kPixels], exposure_s_[BlockRows::kPixels];  // each pixel's next
  std::uint32_t next_step_[BlockRows::kPixels];
};

}  // namespace pecs::sensor::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif
