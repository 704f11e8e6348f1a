// The exact work for pixels that may fire: vectors of them, in stages. Times are s in [0, 1] within the interval, or z
// within a step of the photoreceptor. Included once per instruction set.
#if defined(PECS_ACTIVE_PIXELS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef PECS_ACTIVE_PIXELS_INL_H_
#undef PECS_ACTIVE_PIXELS_INL_H_
#else
#define PECS_ACTIVE_PIXELS_INL_H_
#endif

#include <algorithm>
#include <span>

#include "models/pecs/math-inl.h"
// then
#include "models/pecs/amplifier.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::sensor::HWY_NAMESPACE {

inline std::uint32_t lanes() { return static_cast<std::uint32_t>(hn::Lanes(F())); }
HWY_INLINE V at(const float* row, std::uint32_t p) { return hn::Load(F(), row + p); }
HWY_INLINE void put(V v, float* row, std::uint32_t p) { hn::Store(v, F(), row + p); }

// A block of pixels: rows with one value per pixel, padded to whole vectors. Index of l, i, g: frame at the interval's
// start, at its end, the one after; index of the other pairs: start, end.
struct BlockRows {
  static constexpr std::uint32_t kPixels = 4096;
  std::uint32_t first = 0, count = 0;
  HWY_ALIGN float memory[23][kPixels];
  float* l[3] = {memory[0], memory[1], memory[2]};  // ln I
  float* i[3] = {memory[3], memory[4], memory[5]};  // photo- plus dark current I [fA]
  float* g[3] = {memory[6], memory[7], memory[8]};  // 1/I
  float* m[2] = {memory[9], memory[10]};            // slope of ln I [1/us]
  float* w[2] = {memory[11], memory[12]};           // photoreceptor: 1/u
  float* v[2] = {memory[13], memory[14]};           // ln u
  float* u[2] = {memory[15], memory[16]};
  float* noise[2] = {memory[17], memory[18]};
  float* y[2] = {memory[19], memory[20]};      // output of the amplifier
  float* inner[2] = {memory[21], memory[22]};  // noise of the photoreceptor, when an amplifier follows
  HWY_ALIGN float reference[kPixels], blind_us[kPixels], on[kPixels], off[kPixels];
};

inline float leak_of(const KernelArguments& a, const IntervalTimes& t) {
  return static_cast<float>(a.constants.leak_per_us) * t.h_us;
}
inline float a_h_of(const KernelArguments& a, const IntervalTimes& t) {
  return static_cast<float>(a.constants.a_per_us) * t.h_us;
}

// A vector of pixels that may fire. Times are s in [0, 1] within the interval, or z within a step of the
// photoreceptor.
struct ActiveLanes {
  HWY_ALIGN float live[kLanes], ready[kLanes];  // 1 or 0; ready: for a step
  HWY_ALIGN float on[kLanes], off[kLanes], reference[kLanes], blind[kLanes], n0[kLanes], drift[kLanes],
      background[kLanes];
  HWY_ALIGN float light[4][kLanes], steepest[kLanes], steepest_second[kLanes];
  HWY_ALIGN float s[kLanes], w[kLanes], i[kLanes], slope[kLanes], v[kLanes];  // state of the photoreceptor
  HWY_ALIGN float y[kLanes];                                                  // of the amplifier
  HWY_ALIGN float follows[kLanes], relaxes[kLanes];                           // its motion
  HWY_ALIGN float ds[kLanes], s_next[kLanes], m0[kLanes];                     // of the next step
  HWY_ALIGN float q[4][kLanes], s0[kLanes], s1[kLanes], z[kLanes];            // of the last step: V with noise and leak
  HWY_ALIGN float next[kLanes], next_on[kLanes];                              // crossing
  const std::uint32_t* pixels;
  std::size_t count;
  bool any_background;
};
HWY_INLINE V get(const float* row) { return hn::Load(F(), row); }
HWY_INLINE void set(float* row, V v) { hn::Store(v, F(), row); }
HWY_INLINE M holds(const float* row) { return hn::Gt(get(row), hn::Zero(F())); }
HWY_INLINE void set(float* row, M m) { set(row, hn::IfThenElseZero(m, hn::Set(F(), 1.0f))); }
HWY_INLINE Cubic<V> cubic(const float (*rows)[kLanes]) {
  return {get(rows[0]), get(rows[1]), get(rows[2]), get(rows[3])};
}
HWY_INLINE void set(float (*rows)[kLanes], const Cubic<V>& c) {
  set(rows[0], c.c0), set(rows[1], c.c1), set(rows[2], c.c2), set(rows[3], c.c3);
}

// The exact work for the pixels of a block that may fire in an interval. kAmplifier needs kReceptor.
template <bool kReceptor, bool kAmplifier>
class ActivePixels {
 public:
  ActivePixels(const KernelArguments& a, BlockRows& rows) : a_(a), rows_(rows) {}

  // background: of these pixels, by time.
  void begin(std::span<const BackgroundEvent> background) {
    background_ = background;
    std::fill_n(background_s_, BlockRows::kPixels, kNone);
  }

  // Processes an interval: the pixels listed in jobs(), and those with background events.
  std::uint32_t* jobs() { return jobs_; }
  std::size_t worked() const { return jobs_count_; }  // pixels processed in the last interval
  void work(const IntervalTimes& t, std::size_t jobs) {
    jobs_count_ = jobs;
    take_background(t);
    if (jobs_count_ > 0) find_events(t);
    for (const BackgroundEvent& e : due_) background_s_[e.pixel - rows_.first] = kNone;
  }

 private:
  static constexpr float kNone = 2;                                // no event: beyond s = 1
  static constexpr float kTolerance = kAmplifier ? 4e-4f : 2e-4f;  // of V, and of y

  // Background events of this interval: each pixel's first into background_s_.
  void take_background(const IntervalTimes& t) {
    std::size_t due = 0;
    while (due < background_.size() && background_[due].t_us < t.t1_us) ++due;
    due_ = background_.first(due);
    background_ = background_.subspan(due);
    for (const BackgroundEvent& e : due_) {
      const std::uint32_t p = e.pixel - rows_.first;
      if (background_s_[p] < kNone) continue;
      background_s_[p] = in_interval(e, t);
      if (std::find(jobs_, jobs_ + jobs_count_, p) == jobs_ + jobs_count_) jobs_[jobs_count_++] = p;
    }
  }
  static float in_interval(const BackgroundEvent& e, const IntervalTimes& t) {
    return std::clamp(static_cast<float>((e.t_us - t.t0_us) / (t.t1_us - t.t0_us)), 0.0f, 0x1.fffffep-1f);
  }

  HWY_INLINE Photoreceptor<V> photoreceptor(const IntervalTimes& t, const ActiveLanes& g) const {
    return {cubic(g.light),
            kTolerance,
            hn::Set(F(), a_h_of(a_, t)),
            get(g.steepest),
            get(g.steepest_second),
            get(g.s),
            get(g.w),
            get(g.i),
            get(g.slope)};
  }

  static HWY_INLINE Amplifier<V> amplifier(const IntervalTimes& t) { return {hn::Set(F(), t.amplifier.x)}; }

  // Each stage runs over all groups, so that the work of one group hides the latency of another.
  HWY_NOINLINE void find_events(const IntervalTimes& t) {
    clock_ = Clock(t);
    const std::size_t groups = (jobs_count_ + lanes() - 1) / lanes();
    std::size_t left = 0;
    for (std::size_t k = 0; k < groups; ++k) {
      gather(t, groups_[k], k * lanes());
      at_work_[left++] = &groups_[k];
    }
    while (left > 0) {
      const std::span<ActiveLanes* const> work(at_work_, left);
      // Most pixels that fired search on within their step.
      std::size_t ready = 0;
      for (ActiveLanes* g : work)
        if (!hn::AllFalse(F(), holds(g->ready))) to_step_[ready++] = g;
      const std::span<ActiveLanes* const> steps(to_step_, ready);
      if constexpr (kReceptor) {
        for (ActiveLanes* g : steps) choose_step(t, *g);
        for (ActiveLanes* g : steps) take_step(t, *g);
      }
      for (ActiveLanes* g : steps) end_step(t, *g);
      for (ActiveLanes* g : work) find_crossing(*g);
      left = 0;
      for (ActiveLanes* g : work)
        if (fire(t, *g)) at_work_[left++] = g;
    }
    for (std::size_t k = 0; k < groups; ++k) scatter(t, groups_[k]);
    flush_events();
  }

  void gather(const IntervalTimes& t, ActiveLanes& g, std::size_t job) {
    const F f;
    g.pixels = jobs_ + job;
    g.count = std::min<std::size_t>(lanes(), jobs_count_ - job);
    for (std::size_t k = g.count; k < lanes(); ++k) jobs_[job + k] = jobs_[job];  // not live
    const auto index = hn::BitCast(I32(), hn::LoadU(U32(), g.pixels));
    const auto of = [&](const float* row) { return hn::GatherIndex(f, row, index); };
    const V one = hn::Set(f, 1.0f), zero = hn::Zero(f), h = hn::Set(f, t.h_us);
    set(g.live, hn::FirstN(f, g.count));
    set(g.ready, hn::FirstN(f, g.count));
    set(g.on, of(rows_.on));
    set(g.off, of(rows_.off));
    set(g.reference, of(rows_.reference));
    set(g.blind, hn::Mul(of(rows_.blind_us), hn::Set(f, t.per_h)));
    const V n0 = of(rows_.noise[0]);
    set(g.n0, n0);
    set(g.drift, hn::Add(hn::Sub(of(rows_.noise[1]), n0), hn::Set(f, leak_of(a_, t))));
    const V background = of(background_s_);
    set(g.background, background);
    g.any_background = !hn::AllFalse(f, hn::Lt(background, hn::Set(f, kNone)));
    const Cubic<V> l = hermite(of(rows_.l[0]), of(rows_.l[1]), hn::Mul(of(rows_.m[0]), h), hn::Mul(of(rows_.m[1]), h));
    set(g.light, l);
    set(g.q, l);
    set(g.s, zero);
    set(g.s0, zero);
    set(g.s1, one);
    set(g.z, zero);
    if constexpr (kReceptor) {
      Photoreceptor<V> r{l, kTolerance, hn::Set(f, a_h_of(a_, t)), zero, zero, zero, zero, zero, zero};
      r.bound();
      set(g.steepest, r.steepest);
      set(g.steepest_second, r.steepest_second);
      set(g.w, of(rows_.w[0]));
      set(g.i, of(rows_.i[0]));
      set(g.slope, l.c1);
      set(g.v, of(rows_.v[0]));
      set_motion(g, photoreceptor(t, g).motion());
      if constexpr (kAmplifier) set(g.y, of(rows_.y[0]));
    }
  }

  static HWY_INLINE void set_motion(ActiveLanes& g, const Photoreceptor<V>::Motion& motion) {
    set(g.follows, motion.follows);
    set(g.relaxes, motion.relaxes);
  }

  HWY_INLINE void choose_step(const IntervalTimes& t, ActiveLanes& g) {
    const Photoreceptor<V> r = photoreceptor(t, g);
    V longest = hn::Set(F(), 1.0f);
    const Photoreceptor<V>::Motion now{get(g.follows), get(g.relaxes)};
    if constexpr (kAmplifier) longest = amplifier(t).step_length(r, now, get(g.v), get(g.y));
    const Photoreceptor<V>::Step step = r.choose(now, longest);
    set(g.ds, step.ds);
    set(g.s_next, step.end);
    set(g.m0, step.slope_of_v);
  }

  HWY_INLINE void take_step(const IntervalTimes& t, ActiveLanes& g) {
    Photoreceptor<V> r = photoreceptor(t, g);
    r.take(holds(g.ready), get(g.ds), get(g.s_next));
    set(g.w, r.w);
    set(g.i, r.i);
    set(g.slope, r.slope);
  }

  HWY_INLINE void end_step(const IntervalTimes& t, ActiveLanes& g) {
    const F f;
    const M ready = holds(g.ready);
    const V zero = hn::Zero(f), one = hn::Set(f, 1.0f), begin = kReceptor ? get(g.s) : zero;
    const V end = kReceptor ? get(g.s_next) : one;
    Cubic<V> v = cubic(g.light);
    set(g.s, hn::IfThenElse(ready, end, get(g.s)));
    if constexpr (kReceptor) {
      const Photoreceptor<V> r = photoreceptor(t, g);
      const V v1 = hn::IfThenElse(ready, hn::Neg(ln(r.w)), get(g.v));
      const Photoreceptor<V>::Motion now = r.motion();
      set_motion(g, now);
      const V v0 = get(g.v), m0 = get(g.m0), m1 = r.slope_of_v(now, get(g.ds));
      if constexpr (kAmplifier) {
        const V y = get(g.y);
        const Amplifier<V>::Step step = amplifier(t).take(y, v0, v1, m0, m1, get(g.ds));
        v = step.y;
        set(g.y, hn::IfThenElse(ready, step.end, y));
      } else {
        v = hermite(v0, v1, m0, m1);
      }
      set(g.v, v1);
    }
    const V drift = get(g.drift);
    v.c0 = hn::Add(v.c0, hn::MulAdd(drift, begin, get(g.n0)));
    v.c1 = hn::MulAdd(drift, hn::Sub(end, begin), v.c1);
    const Cubic<V> q = select(ready, v, cubic(g.q));
    const V s0 = hn::IfThenElse(ready, begin, get(g.s0)), s1 = hn::IfThenElse(ready, end, get(g.s1));
    V z = hn::IfThenElse(ready, zero, get(g.z));
    const V blind = get(g.blind);
    const M blinded = hn::And(ready, hn::Gt(blind, zero)), sleeps = hn::And(blinded, hn::Ge(blind, s1));
    const M wakes = hn::AndNot(sleeps, blinded);
    if (!hn::AllFalse(f, wakes)) {
      z = hn::IfThenElse(wakes, hn::Max(zero, hn::Div(hn::Sub(blind, s0), hn::Sub(s1, s0))), z);
      set(g.reference, hn::IfThenElse(wakes, q.at(z), get(g.reference)));
      set(g.blind, hn::IfThenZeroElse(wakes, blind));
      mark(t, g, wakes, hn::MulAdd(hn::Sub(s1, s0), z, s0));
    }
    set(g.q, q);
    set(g.s0, s0);
    set(g.s1, s1);
    set(g.z, z);
    set(g.ready, sleeps);
  }

  HWY_INLINE void find_crossing(ActiveLanes& g) {
    const V reference = get(g.reference);
    const Crossing<V> next =
        first_crossing(cubic(g.q), get(g.z), hn::Sub(reference, get(g.off)), hn::Add(reference, get(g.on)));
    set(g.next, next.at);
    set(g.next_on, next.on);
  }

  // Emits the crossings found. False when all lanes have finished the interval.
  HWY_INLINE bool fire(const IntervalTimes& t, ActiveLanes& g) {
    const F f;
    const V one = hn::Set(f, 1.0f), zero = hn::Zero(f), s0 = get(g.s0), s1 = get(g.s1), ds = hn::Sub(s1, s0);
    const M seeking = hn::AndNot(holds(g.ready), holds(g.live));
    M by_noise = hn::Lt(one, zero);
    if (g.any_background) by_noise = background_first(t, g, seeking);
    const V at_z = get(g.next);
    const M fires = hn::And(seeking, hn::Le(at_z, one));
    M ready = hn::Or(holds(g.ready), hn::AndNot(fires, seeking));
    if (!hn::AllFalse(f, fires)) {
      const V s = hn::MulAdd(ds, at_z, s0);
      emit(t, g, fires, by_noise, s);
      // The reference is V when the refractory period ends.
      const V refractory = hn::Mul(hn::Set(f, static_cast<float>(a_.constants.refractory_us)), hn::Set(f, t.per_h));
      const V until = hn::Add(s, refractory);
      const M rests = hn::Gt(refractory, zero), sleeps = hn::And(fires, hn::And(rests, hn::Ge(until, s1)));
      const M resets = hn::AndNot(sleeps, fires);
      const V after = hn::IfThenElse(rests, hn::Div(hn::Sub(until, s0), ds), at_z);
      const V z = hn::IfThenElse(resets, after, get(g.z));
      set(g.blind, hn::IfThenElse(sleeps, until, get(g.blind)));
      set(g.reference, hn::IfThenElse(resets, cubic(g.q).at(z), get(g.reference)));
      set(g.z, z);
      ready = hn::Or(ready, sleeps);
      mark(t, g, resets, hn::MulAdd(ds, z, s0));
    }
    const M live = hn::AndNot(hn::And(ready, hn::Ge(get(g.s), one)), holds(g.live));
    set(g.live, live);
    set(g.ready, hn::And(ready, live));
    return !hn::AllFalse(f, live);
  }

  void scatter(const IntervalTimes& t, ActiveLanes& g) {
    const F f;
    const V blind = get(g.blind), left = hn::Mul(hn::Sub(blind, hn::Set(f, 1.0f)), hn::Set(f, t.h_us));
    set(g.blind, hn::IfThenElseZero(hn::Gt(blind, hn::Zero(f)), hn::Max(left, hn::Set(f, 1e-6f))));
    for (std::size_t k = 0; k < g.count; ++k) {
      const std::uint32_t p = g.pixels[k];
      rows_.reference[p] = g.reference[k];
      rows_.blind_us[p] = g.blind[k];
      if constexpr (kReceptor) {
        rows_.w[1][p] = g.w[k];
        rows_.v[1][p] = g.v[k];
        rows_.u[1][p] = 1 / g.w[k];
        if constexpr (kAmplifier) rows_.y[1][p] = g.y[k];
      }
    }
  }

  template <class Work>  // for each lane of the mask
  static void each(M which, const Work& work) {
    HWY_ALIGN float flag[kLanes];
    hn::Store(hn::IfThenElseZero(which, hn::Set(F(), 1.0f)), F(), flag);
    for (std::size_t k = 0; k < hn::Lanes(F()); ++k)
      if (flag[k] != 0) work(k);
  }

  // A pixel's noise at s, without the drift of the leak.
  float noise_at(std::uint32_t p, float s) const {
    return rows_.noise[0][p] + (rows_.noise[1][p] - rows_.noise[0][p]) * s;
  }

  void mark(const IntervalTimes& t, const ActiveLanes& g, M which, V s) {
    if (!a_.marks) return;
    HWY_ALIGN float at_s[kLanes];
    hn::Store(s, F(), at_s);
    each(which, [&](std::size_t k) {
      const std::uint32_t p = g.pixels[k];
      a_.marks[rows_.first + p] = {t.t0_us + double{at_s[k]} * t.h_us, noise_at(p, at_s[k]), 0};
    });
  }

  Cause cause(const IntervalTimes& t, std::uint32_t p, float s, bool on) const {
    const ResetMark& mark = a_.marks[rows_.first + p];
    const double sign = on ? 1 : -1;
    const double noise = sign * (noise_at(p, s) - mark.noise);
    const double leaked = sign * a_.constants.leak_per_us * (t.t0_us + double{s} * t.h_us - mark.t_us);
    const double signal = (on ? rows_.on[p] : rows_.off[p]) - noise - leaked - sign * double{mark.phase};
    return signal >= std::max(noise, leaked) ? Cause::signal : leaked > noise ? Cause::leak : Cause::noise;
  }

  HWY_INLINE void emit(const IntervalTimes& t, const ActiveLanes& g, M fires, M by_noise, V s) {
    const U32 u;
    const Compress compress(fires);
    const VU on = hn::IfThenElseZero(hn::RebindMask(u, holds(g.next_on)), hn::Set(u, 1u << kKeyOnShift));
    const VU pixels = hn::Add(hn::LoadU(u, g.pixels), hn::Set(u, rows_.first));
    compress.store(clock_.us(s), us_ + fired_);
    compress.store(hn::Or(hn::ShiftLeft<kKeyPixelShift>(pixels), on), place_ + fired_);
    if (a_.marks) {
      HWY_ALIGN float at_s[kLanes], noise[kLanes];
      set(at_s, s);
      set(noise, by_noise);
      std::uint32_t* place = place_ + fired_;
      each(fires, [&](std::size_t k) {
        const std::uint32_t p = g.pixels[k];
        const Cause why = noise[k] > 0 ? background_cause_[p] : cause(t, p, at_s[k], g.next_on[k] > 0);
        *place++ |= static_cast<std::uint32_t>(why);
      });
    }
    fired_ += compress.count();
    if (fired_ > kRoom) flush_events();
  }
  void flush_events() {
    clock_.add(us_, place_, fired_, *a_.events);
    fired_ = 0;
  }

  // A background event before the crossing found replaces it. Returns the lanes where it does.
  M background_first(const IntervalTimes& t, ActiveLanes& g, M seeking) {
    const F f;
    HWY_ALIGN float noise[kLanes] = {};
    const BackgroundEvent* const none = due_.data() + due_.size();
    each(seeking, [&](std::size_t k) {
      if (g.background[k] >= kNone) return;
      const std::uint32_t p = g.pixels[k];
      const auto after = [&](const BackgroundEvent* e, float s) {  // the first at s or later
        while (e != none && (e->pixel != rows_.first + p || in_interval(*e, t) < s)) ++e;
        return e;
      };
      const auto time_of = [&](const BackgroundEvent* e) { return e == none ? kNone : in_interval(*e, t); };
      const float length = g.s1[k] - g.s0[k], now = g.s0[k] + length * g.z[k];
      const BackgroundEvent* e = after(due_.data(), std::max(g.background[k], now));
      g.background[k] = time_of(e);
      const float z = (g.background[k] - g.s0[k]) / length;
      if (g.background[k] >= g.s1[k] || z >= g.next[k]) return;
      g.next[k] = std::max(z, 0.0f);
      g.next_on[k] = e->on;
      noise[k] = 1;
      background_cause_[p] = e->cause;
      g.background[k] = time_of(after(e + 1, 0));
    });
    return hn::Gt(hn::Load(f, noise), hn::Zero(f));
  }

  const KernelArguments& a_;
  BlockRows& rows_;
  std::span<const BackgroundEvent> background_, due_;  // of later intervals; of this interval
  HWY_ALIGN float background_s_[BlockRows::kPixels];
  Cause background_cause_[BlockRows::kPixels];
  std::uint32_t jobs_[BlockRows::kPixels + 2 * kLanes];
  std::size_t jobs_count_ = 0;
  Clock clock_;            // of the interval
  std::size_t fired_ = 0;  // events in us_ and place_
  std::int32_t us_[kRoom + 2 * kLanes];
  std::uint32_t place_[kRoom + 2 * kLanes];
  ActiveLanes groups_[BlockRows::kPixels / kLanes + 1];
  ActiveLanes *at_work_[BlockRows::kPixels / kLanes + 1], *to_step_[BlockRows::kPixels / kLanes + 1];
};

}  // namespace pecs::sensor::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif
