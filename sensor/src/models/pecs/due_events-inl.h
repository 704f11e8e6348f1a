// Events of pixels at given times: background events, and exposures of the chip's frames. Included once per
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

#include "light/float_math.h"
#include "models/pecs/event_output-inl.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::sensor::HWY_NAMESPACE {

// Times are s in the interval.
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
      output_.background_cause[p] = e->cause;
      g.background[k] = time_of_event(after(e + 1, 0));
    });
    return holds(replaces);
  }

  // Steps of the amplifier's output (without one, of V), up where an exposure begins and down where it ends. It then
  // relaxes to V (V to the light); the slow part, by itself.
  HWY_INLINE void expose(const IntervalTimes& t, ActiveLanes& g, M exposed) {
    each(exposed, [&](std::size_t k) {
      for (const std::uint32_t p = g.pixels[k]; g.exposure[k] <= g.s[k]; g.exposure[k] = step_s(p, t)) {
        const bool ends = a_.exposures.steps[next_step_[p]].ends;
        const float step = step_of(p), slow = static_cast<float>(ends ? -a_.exposures.slow : a_.exposures.slow);
        if (a_.marks) mark(t, g, k, step, slow);
        if (a_.e) g.e[k] += slow;
        if (a_.constants.b_per_us > 0) {
          g.y[k] += step;
        } else {
          g.v[k] += step;
          g.w[k] *= exp_of(-step);
        }
        ++next_step_[p];
      }
    });
  }

 private:
  static constexpr float kNone = 2;  // no event: beyond s = 1
  static constexpr double kMostStep = 5;
  static constexpr float kEdge = 1e-5f;  // least distance of a step from the interval's ends

  static float in_interval(double t_us, const IntervalTimes& t) {
    return std::clamp(static_cast<float>((t_us - t.t0_us) / (t.t1_us - t.t0_us)), 0.0f, 0x1.fffffep-1f);
  }
  double delay_us(std::uint32_t p) const {
    const auto row = (rows_.first + p) / a_.exposures.width;
    return a_.exposures.row_us * static_cast<double>(row);
  }
  double step_us(std::uint32_t p) const { return a_.exposures.steps[next_step_[p]].t_us + delay_us(p); }
  bool has_steps(const IntervalTimes& t) const {
    return std::ranges::any_of(a_.exposures.steps, [&](const ExposureStep& step) {
      return step.t_us + delay_us(0) < t.t1_us && step.t_us + delay_us(rows_.count - 1) >= t.t0_us;
    });
  }
  float step_s(std::uint32_t p, const IntervalTimes& t) const {
    if (next_step_[p] == a_.exposures.steps.size() || step_us(p) >= t.t1_us) return kNone;
    return std::clamp(in_interval(step_us(p), t), kEdge, 1 - kEdge);
  }
  void mark(const IntervalTimes& t, const ActiveLanes& g, std::size_t k, float step, float slow) {
    ResetMark& mark = a_.marks[rows_.first + g.pixels[k]];
    mark.step_us = t.t0_us + double{g.exposure[k]} * t.h_us;
    mark.step = step, mark.slow = slow;
    mark.output = Cubic<float>{g.q[0][k], g.q[1][k], g.q[2][k], g.q[3][k]}.at(1.0f) + g.z1[k];
  }
  // A charge on the photoreceptor's node, drawn for each pixel and frame.
  float step_of(std::uint32_t p) const {
    const ExposureStep& step = a_.exposures.steps[next_step_[p]];
    const Random4 r = random4(a_.noise_seed, rows_.first + p, step.frame, Purpose::exposure);
    const double size = a_.exposures.step * std::exp(a_.exposures.spread * sensor::gaussian(r[0]));
    return static_cast<float>(std::min(size, kMostStep) * (step.ends ? -1 : 1));
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
