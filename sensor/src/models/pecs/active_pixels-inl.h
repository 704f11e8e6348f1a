// The exact work for pixels that may fire: vectors of them, in stages. Times are s in [0, 1] within the interval, or z
// within a step of the photoreceptor. Included once per instruction set.
#if defined(PECS_ACTIVE_PIXELS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef PECS_ACTIVE_PIXELS_INL_H_
#undef PECS_ACTIVE_PIXELS_INL_H_
#else
#define PECS_ACTIVE_PIXELS_INL_H_
#endif

#include <algorithm>
#include <optional>
#include <span>
#include <utility>

#include "models/pecs/due_events-inl.h"
// then
#include "models/pecs/noise.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::sensor::HWY_NAMESPACE {

// The exact work for the pixels of a block that may fire in an interval. kAmplifier needs kReceptor.
template <bool kReceptor, bool kAmplifier>
class ActivePixels {
 public:
  static constexpr float kFewCrossings = 0.25f;  // expected in a part of a step that is not split

  ActivePixels(const KernelArguments& a, BlockRows& rows)
      : a_(a), rows_(rows), output_(a, rows), due_(a, rows, output_), is_noisy_(kAmplifier && a.noise_std > 0) {
    for (ActiveLanes& g : groups_) g = {};
  }

  // background: of these pixels, by time.
  void begin(std::span<const BackgroundEvent> background) { due_.begin(background); }

  // Processes an interval: the pixels listed in jobs(), and those with due events.
  std::uint32_t* jobs() { return jobs_; }
  std::size_t worked() const { return jobs_count_; }  // pixels processed in the last interval
  void work(const IntervalTimes& t, std::size_t jobs) {
    jobs_count_ = due_.list(t, jobs_, jobs);
    if (jobs_count_ > 0) find_events(t);
    due_.end_interval();
  }

  // Shot noise of I and of u are added: in light that rises, I is the larger one.
  HWY_INLINE V noise_std_of(V relaxation, V exposure) const {
    return a_.noise_std * sqrt(0.5f + hn::Div(0.5f * exposure, relaxation));
  }

 private:
  static constexpr float kTolerance = kAmplifier ? 4e-4f : 2e-4f;  // of V, and of y
  static constexpr float kStraight = 0.01f;  // of the noise: deviation from a straight line that does not count
  static constexpr float kStraight_us = 2;   // the same, where the path crosses
  // A refractory period that ends so shortly before an exposure's step, or at it, ends after it.
  static constexpr float kTie_us = 0.5f;
  static constexpr float kLastWake = 1 - 1e-6f;  // later ones end in the next interval, whose start may be such a step
  static constexpr float kShortest = 0x1p-21f;   // part of a step that is not split, relative to its end

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

  // A few groups of pixels, each in the stage that most of its pixels are in. Pixels that have finished the interval
  // are replaced.
  HWY_NOINLINE void find_events(const IntervalTimes& t) {
    const F f;
    output_.begin(t);
    next_job_ = 0;
    for (bool any = true; any;) {
      any = false;
      for (ActiveLanes& g : groups_) {
        M live = holds(g.live);
        if (next_job_ < jobs_count_ && hn::CountTrue(f, live) <= hn::Lanes(f) * 3 / 4) {
          gather(t, g, hn::Not(live));
          live = holds(g.live);
        }
        if (hn::AllFalse(f, live)) continue;
        any = true;
        const auto count = [&](const float* row) { return hn::CountTrue(f, holds(row)); };
        const std::size_t steps = count(g.ready), leaves = count(g.leaf);
        if (hn::CountTrue(f, live) - steps - leaves >= std::max(steps, leaves))
          examine(t, g);
        else if (steps >= leaves)
          step(t, g);
        else
          solve(t, g);
      }
    }
    output_.flush();
  }

  // Takes pixels in place of those in `free` lanes.
  HWY_NOINLINE void gather(const IntervalTimes& t, ActiveLanes& g, M free) {
    const F f;
    each(free, [&](std::size_t k) {
      g.live[k] = g.ready[k] = next_job_ < jobs_count_ ? 1.0f : 0.0f;
      if (next_job_ < jobs_count_) g.pixels[k] = jobs_[next_job_++];
    });
    const M in = hn::And(free, holds(g.live));
    const auto index = hn::BitCast(I32(), hn::Load(U32(), g.pixels));
    const auto of = [&](const float* row) { return hn::GatherIndex(f, row, index); };
    const auto take = [&](float* row, V v) { set(row, hn::IfThenElse(in, v, get(row))); };
    const V one = hn::Set(f, 1.0f), zero = hn::Zero(f), h = hn::Set(f, t.h_us);
    take(g.leaf, zero);
    take(g.splits, zero);
    take(g.on, of(rows_.on));
    take(g.off, of(rows_.off));
    take(g.reference, of(rows_.reference));
    take(g.blind, hn::Mul(of(rows_.blind_us), hn::Set(f, t.per_h)));
    take(g.background, of(due_.background_s()));
    take(g.exposure, of(due_.exposure_s()));
    if (is_noisy_) {
      take(g.n_step, of(rows_.n[0]));
      take(g.z_step, of(rows_.z[0]));
      take(g.n_last, of(rows_.n[1]));
      take(g.z_last, of(rows_.z[1]));
      take(g.rate, of(rows_.relaxation));
      take(g.std, of(rows_.noise_std));
      const V gate = of(rows_.gate);
      take(g.gate, gate);
      take(g.free, hn::IfThenElseZero(hn::Lt(gate, zero), one));
      take(g.candidate, zero);
      const VU pixels = hn::Add(hn::Load(U32(), g.pixels), hn::Set(U32(), rows_.first));
      g.random.start(in, random_of(pixels, t.step, Purpose::path, a_.noise_seed));
    }
    const U32 u;
    hn::Store(hn::IfThenZeroElse(hn::RebindMask(u, in), hn::Load(u, g.later)), u, g.later);
    const Cubic<V> l = hermite(of(rows_.l[0]), of(rows_.l[1]), hn::Mul(of(rows_.m[0]), h), hn::Mul(of(rows_.m[1]), h));
    set(g.light, select(in, l, cubic(g.light)));
    take(g.s, zero);
    if constexpr (kReceptor) {
      Photoreceptor<V> r{l, kTolerance, hn::Set(f, a_h_of(a_, t)), zero, zero, zero, zero, zero, zero};
      r.bound();
      take(g.steepest, r.steepest);
      take(g.steepest_second, r.steepest_second);
      take(g.w, of(rows_.w[0]));
      take(g.i, of(rows_.i[0]));
      take(g.slope, l.c1);
      take(g.v, of(rows_.v[0]));
      set_motion(g, photoreceptor(t, g).motion());
      if constexpr (kAmplifier) take(g.y, of(rows_.y[0]));
      if (a_.e) take(g.e, of(rows_.e[0]));
    }
  }
  // Ends a pixel's interval.
  void scatter(const IntervalTimes& t, ActiveLanes& g, std::size_t k) {
    const std::uint32_t p = g.pixels[k];
    g.live[k] = 0;
    rows_.reference[p] = g.reference[k];
    rows_.blind_us[p] = g.blind[k] > 0 ? std::max((g.blind[k] - 1) * t.h_us, 1e-6f) : 0;
    if constexpr (kReceptor) {
      rows_.w[1][p] = g.w[k];
      rows_.v[1][p] = g.v[k];
      rows_.u[1][p] = 1 / g.w[k];
      if constexpr (kAmplifier) rows_.y[1][p] = g.y[k];
      if (a_.e) rows_.e[1][p] = g.e[k];
      if (is_noisy_) rows_.n[1][p] = g.n_step[k], rows_.z[1][p] = g.z_step[k];
    }
  }

  HWY_NOINLINE void step(const IntervalTimes& t, ActiveLanes& g) {
    if constexpr (kReceptor) {
      choose_step(t, g);
      take_step(t, g);
    }
    end_step(t, g);
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
    const V one = hn::Set(F(), 1.0f);
    if (a_.e) {  // as long as e is nearly a cubic
      const V x = hn::Set(F(), slow_h_of(a_, t));
      longest = hn::IfThenElse(hn::Gt(hn::Mul(hn::Abs(get(g.e)), x), hn::Set(F(), kTolerance)),
                               hn::Min(longest, hn::Div(one, x)), longest);
    }
    const Photoreceptor<V>::Step step = r.choose(now, longest, hn::Min(get(g.exposure), one));
    set(g.ds, step.ds);
    set(g.s_next, step.end);
    set(g.m0, step.slope_of_v);
  }

  HWY_INLINE void take_step(const IntervalTimes& t, ActiveLanes& g) {
    const F f;
    Photoreceptor<V> r = photoreceptor(t, g);
    const M ready = holds(g.ready);
    const V w0 = r.w, exposure = r.take(ready, get(g.ds), get(g.s_next));
    set(g.w, r.w);
    set(g.i, r.i);
    set(g.slope, r.slope);
    if (!is_noisy_) return;
    const M free = hn::And(ready, holds(g.free));
    if (hn::AllFalse(f, free)) return;
    // Fast light: rate and strength of the noise are those of the step.
    const V ds = get(g.ds), one = hn::Set(f, 1.0f), a_h = hn::Mul(ds, hn::Set(f, a_h_of(a_, t)));
    const V relaxation = relaxation_of(exposure, get(g.v), hn::Neg(ln(r.w)), hn::Div(one, w0), hn::Div(one, r.w), a_h);
    set(g.rate, hn::IfThenElse(free, hn::Div(relaxation, ds), get(g.rate)));
    set(g.std, hn::IfThenElse(free, noise_std_of(relaxation, exposure), get(g.std)));
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
      if (a_.e) {
        const V e0 = get(g.e), x = hn::Mul(hn::Set(f, -slow_h_of(a_, t)), get(g.ds)), e1 = hn::Mul(e0, exp(x));
        v = v + hermite(e0, e1, hn::Mul(x, e0), hn::Mul(x, e1));
        set(g.e, hn::IfThenElse(ready, e1, e0));
      }
    }
    const V leak = hn::Set(f, t.leak);
    v.c0 = hn::MulAdd(leak, begin, v.c0);
    v.c1 = hn::MulAdd(leak, hn::Sub(end, begin), v.c1);
    set(g.q, select(ready, v, cubic(g.q)));
    set(g.s0, hn::IfThenElse(ready, begin, get(g.s0)));
    set(g.s1, hn::IfThenElse(ready, end, get(g.s1)));
    set(g.from, hn::IfThenElse(ready, zero, get(g.from)));
    set(g.to, hn::IfThenElse(ready, one, get(g.to)));
    set(g.ready, zero);
    if (is_noisy_)
      noise_of_step(t, g, ready, begin, end);
    else
      set(g.leaf, hn::Or(ready, holds(g.leaf)));
    set(g.wakes_before, hn::IfThenElse(ready, hn::Set(f, kLastWake), get(g.wakes_before)));
    if constexpr (kReceptor) {
      if (const M exposed = hn::And(ready, hn::Ge(end, get(g.exposure))); !hn::AllFalse(f, exposed)) {
        const V last = hn::Sub(end, hn::Set(f, kTie_us * t.per_h));
        set(g.wakes_before, hn::IfThenElse(exposed, last, get(g.wakes_before)));
        due_.expose(t, g, exposed);
        set_motion(g, photoreceptor(t, g).motion());
      }
    }
  }

  // The noise at the end of a step, between that at its start and at the end of the interval.
  HWY_INLINE void noise_of_step(const IntervalTimes& t, ActiveLanes& g, M ready, V begin, V end) {
    const F f;
    const NoiseState<V> start{get(g.n_step), get(g.z_step)};
    NoiseState<V> at_end{get(g.n_last), get(g.z_last)};
    const M free = holds(g.free), drawn = hn::And(ready, hn::Or(free, hn::Lt(end, hn::Set(f, 1.0f))));
    if (!hn::AllFalse(f, drawn)) {
      const VU random[] = {g.random.next(drawn), g.random.next(drawn)};
      const V ds = hn::Sub(end, begin), rest = hn::Max(hn::Set(f, 1e-6f), hn::Sub(hn::Set(f, 1.0f), end));
      const V rate = get(g.rate), b = hn::Set(f, t.amplifier.x);
      const NoiseState<V> between =
          draw_between(noise_step(hn::Mul(rate, ds), hn::Mul(b, ds)), noise_step(hn::Mul(rate, rest), hn::Mul(b, rest)),
                       start, at_end, free, get(g.std), gaussian(random[0]), gaussian(random[1]));
      at_end = {hn::IfThenElse(drawn, between.n, at_end.n), hn::IfThenElse(drawn, between.z, at_end.z)};
    }
    const auto put_ready = [&](float* row, V v) { set(row, hn::IfThenElse(ready, v, get(row))); };
    put_ready(g.n0, start.n);
    put_ready(g.z0, start.z);
    for (float* row : {g.n_step, g.n1}) put_ready(row, at_end.n);
    for (float* row : {g.z_step, g.z1}) put_ready(row, at_end.z);
  }

  // Decides on the parts of the steps at work. Where noise makes no crossing, a part is done. Where it may make a few,
  // a crossing is drawn by its density. Otherwise the part is split, until the noise within it hardly differs from a
  // straight line: then its crossings are solved for (leaf).
  HWY_NOINLINE void examine(const IntervalTimes& t, ActiveLanes& g) {
    const F f;
    const U32 u32;
    const M seeking = hn::AndNot(hn::Or(holds(g.ready), holds(g.leaf)), holds(g.live));
    if (!hn::AllFalse(f, holds(g.splits))) split(t, g);
    wake(t, g, seeking);
    const V zero = hn::Zero(f), from = get(g.from), to = get(g.to), third = hn::Set(f, 1.0f / 3);
    const V begin = time_of(g, from), end = time_of(g, to), length = hn::Sub(end, begin);
    const Cubic<V> v = part_of(g);
    const V v1 = v.at(hn::Set(f, 1.0f)), slope1 = v.slope(hn::Set(f, 1.0f));
    const V b1 = hn::MulAdd(third, v.c1, v.c0), b2 = hn::NegMulAdd(third, slope1, v1), middle = 3.0f * hn::Sub(b2, b1);
    const V high = hn::Max(hn::Max(v.c0, v1), hn::Max(b1, b2)), low = hn::Min(hn::Min(v.c0, v1), hn::Min(b1, b2));
    const V steepest = hn::Max(hn::Max(v.c1, slope1), middle), least = hn::Min(hn::Min(v.c1, slope1), middle);

    const V x = hn::Mul(get(g.rate), length), y = hn::Mul(hn::Set(f, t.amplifier.x), length);
    const NoiseState<V> noise0{get(g.n0), get(g.z0)}, noise1{get(g.n1), get(g.z1)};
    const NoiseReach<V> reach = noise_reach(x, y, get(g.std));
    const auto bounds = reach.bounds(noise0, noise1);
    const V reference = get(g.reference), level_on = hn::Add(reference, get(g.on));
    const V level_off = hn::Sub(reference, get(g.off));
    const V ons = most_crossings(hn::Sub(level_on, hn::Add(high, bounds.above)), steepest, reach);
    const V offs = most_crossings(hn::Sub(hn::Add(low, bounds.below), level_off), hn::Neg(least), reach);
    const V expected = hn::Add(ons, offs);

    const V at1 = hn::Add(v1, noise1.z), rise = hn::Abs(hn::Sub(at1, hn::Add(v.c0, noise0.z)));
    const M crosses = hn::Or(hn::Ge(at1, level_on), hn::Le(at1, level_off));
    const V blind = get(g.blind);
    const M sleeps = hn::And(seeking, hn::Ge(blind, latest_wake(g, begin, end))), awake = hn::AndNot(sleeps, seeking);
    const M is_due = hn::Lt(get(g.background), end);
    const VU later = hn::Load(u32, g.later);
    const M is_candidate = hn::Gt(hn::Abs(get(g.candidate)), zero);
    const M ends_here = hn::And(is_candidate, hn::RebindMask(f, hn::Eq(later, hn::Load(u32, g.candidate_later))));
    const M must = hn::Or(is_due, ends_here);
    const M many = hn::And(awake, hn::Or(must, hn::Ge(expected, hn::Set(f, kFewCrossings))));
    // Straight: by what noise moves within the amplifier's time, or by time where the path crosses.
    const V h = hn::Mul(length, hn::Set(f, t.h_us));
    const M fine = hn::Or(hn::Le(reach.std, kStraight * a_.noise_std * share_moved(x, y)),
                          hn::And(crosses, hn::Lt(hn::Mul(reach.std, h), hn::Mul(hn::Set(f, kStraight_us), rise))));
    const M full = hn::Or(hn::RebindMask(f, hn::Gt(later, hn::Set(u32, kDepth - 3))),
                          hn::Le(hn::Sub(to, from), hn::Mul(hn::Set(f, kShortest), to)));
    const M leaf = hn::And(many, hn::Or(fine, full));
    set(g.leaf, hn::Or(leaf, holds(g.leaf)));
    set(g.splits, hn::AndNot(leaf, many));

    const M may = hn::AndNot(many, hn::And(awake, hn::Gt(expected, hn::Set(f, 1e-10f))));
    V gate = get(g.gate);
    const M open = hn::Ge(gate, hn::Set(f, kNoGate)), gated = hn::AndNot(open, hn::Ge(gate, zero));
    gate = hn::IfThenElse(gated, gate, uniform(g.random.next(hn::AndNot(gated, may))));
    const M proposes = hn::And(may, hn::Lt(gate, expected));
    const V left = hn::IfThenElse(proposes, hn::Set(f, kShut), hn::Sub(gate, expected));
    set(g.gate, hn::IfThenElse(hn::And(gated, may), left, get(g.gate)));
    M done = hn::Or(sleeps, hn::AndNot(many, awake));
    if (!hn::AllFalse(f, proposes)) {
      HWY_ALIGN float of_on[kLanes], of_off[kLanes], is_done[kLanes];
      set(of_on, ons);
      set(of_off, offs);
      set(is_done, done);
      each(proposes, [&](std::size_t k) { is_done[k] = propose(t, g, k, of_on[k], of_off[k]) ? 0.0f : 1.0f; });
      done = holds(is_done);
    }
    next_part(t, g, done);
  }

  // A refractory period that ends nearer to an end of a part, relative to its length, ends there: noise cannot be drawn
  // over so short a time in floats.
  static constexpr float kWakes = 1e-4f;
  static HWY_INLINE V latest_wake(const ActiveLanes& g, V begin, V end) {
    return hn::Min(hn::NegMulAdd(hn::Set(F(), kWakes), hn::Sub(end, begin), end), get(g.wakes_before));
  }

  // The part at work begins where the refractory period ends in it.
  HWY_INLINE void wake(const IntervalTimes& t, ActiveLanes& g, M seeking) {
    const F f;
    const V blind = get(g.blind), from = get(g.from), begin = time_of(g, from), end = time_of(g, get(g.to));
    const M wakes = hn::And(seeking, hn::And(hn::Gt(blind, hn::Zero(f)), hn::Lt(blind, latest_wake(g, begin, end))));
    if (hn::AllFalse(f, wakes)) return;
    set(g.blind, hn::IfThenZeroElse(wakes, blind));
    const M at_begin = hn::And(wakes, hn::Le(blind, hn::MulAdd(hn::Set(f, kWakes), hn::Sub(end, begin), begin)));
    const V z0 = get(g.z0);
    begin_at(t, g, at_begin, from, hn::Add(cubic(g.q).at(from), z0), {get(g.n0), z0});
    const M which = hn::AndNot(at_begin, wakes);
    if (hn::AllFalse(f, which)) return;
    const V before = hn::Sub(blind, begin), after = hn::Sub(end, blind), u = hn::Div(before, hn::Sub(end, begin));
    const V rate = get(g.rate), b = hn::Set(f, t.amplifier.x), z = hn::MulAdd(u, hn::Sub(get(g.to), from), from);
    const VU r0 = g.random.next(which), r1 = g.random.next(which);
    const NoiseState<V> noise = draw_between(
        noise_step(hn::Mul(rate, before), hn::Mul(b, before)), noise_step(hn::Mul(rate, after), hn::Mul(b, after)),
        {get(g.n0), z0}, {get(g.n1), get(g.z1)}, hn::FirstN(f, 0), get(g.std), gaussian(r1), gaussian(r0));
    begin_at(t, g, which, z, hn::Add(cubic(g.q).at(z), noise.z), noise);
  }
  // The reference of pixels is their output there, and the part at work begins at z.
  HWY_INLINE void begin_at(const IntervalTimes& t, ActiveLanes& g, M which, V z, V output, const NoiseState<V>& noise) {
    set(g.reference, hn::IfThenElse(which, output, get(g.reference)));
    output_.mark(t, g, which, time_of(g, z), noise.z);
    set(g.n0, hn::IfThenElse(which, noise.n, get(g.n0)));
    set(g.z0, hn::IfThenElse(which, noise.z, get(g.z0)));
    set(g.from, hn::IfThenElse(which, z, get(g.from)));
  }

  // Splits parts in the middle.
  HWY_INLINE void split(const IntervalTimes& t, ActiveLanes& g) {
    const U32 u;
    const M which = holds(g.splits);
    const V from = get(g.from), to = get(g.to), half = hn::Set(F(), 0.5f);
    const V length = hn::Mul(hn::Mul(half, hn::Sub(to, from)), hn::Sub(get(g.s1), get(g.s0)));
    const NoiseStep<V> step = noise_step(hn::Mul(get(g.rate), length), hn::Mul(hn::Set(F(), t.amplifier.x), length));
    const VU r0 = g.random.next(which), r1 = g.random.next(which);
    const NoiseState<V> noise = draw_between(step, step, {get(g.n0), get(g.z0)}, {get(g.n1), get(g.z1)},
                                             hn::FirstN(F(), 0), get(g.std), gaussian(r1), gaussian(r0));
    for (std::size_t k = 0; k < lanes(); ++k) {
      const std::uint32_t top = g.later[k];
      g.later_to[top][k] = g.to[k], g.later_n[top][k] = g.n1[k], g.later_z[top][k] = g.z1[k];
    }
    const VU later = hn::Load(u, g.later);
    hn::Store(hn::IfThenElse(hn::RebindMask(u, which), hn::Add(later, hn::Set(u, 1)), later), u, g.later);
    set(g.to, hn::IfThenElse(which, hn::Mul(half, hn::Add(from, to)), to));
    set(g.n1, hn::IfThenElse(which, noise.n, get(g.n1)));
    set(g.z1, hn::IfThenElse(which, noise.z, get(g.z1)));
  }
  // Goes on to the parts after those at work.
  HWY_INLINE void next_part(const IntervalTimes& t, ActiveLanes& g, M done) {
    const F f;
    const U32 u;
    if (hn::AllFalse(f, done)) return;
    const VU later = hn::Load(u, g.later);
    const M has = hn::RebindMask(f, hn::Gt(later, hn::Zero(u))), more = hn::And(done, has),
            over = hn::AndNot(has, done);
    if (!hn::AllFalse(f, more)) {
      HWY_ALIGN float to[kLanes], n[kLanes], z[kLanes];
      for (std::size_t k = 0; k < lanes(); ++k) {
        const std::uint32_t top = g.later[k] - (g.later[k] > 0);
        to[k] = g.later_to[top][k], n[k] = g.later_n[top][k], z[k] = g.later_z[top][k];
      }
      const auto move = [&](float* start, float* end, const float* next) {
        const V before = get(end);
        set(start, hn::IfThenElse(more, before, get(start)));
        set(end, hn::IfThenElse(more, get(next), before));
      };
      move(g.from, g.to, to);
      move(g.n0, g.n1, n);
      move(g.z0, g.z1, z);
      hn::Store(hn::IfThenElse(hn::RebindMask(u, more), hn::Sub(later, hn::Set(u, 1)), later), u, g.later);
      set(g.gate, hn::IfThenElse(more, hn::Set(f, kNoGate), get(g.gate)));
    }
    if (hn::AllFalse(f, over)) return;
    const M goes_on = hn::And(over, hn::Lt(get(g.s), hn::Set(f, 1.0f)));
    set(g.ready, hn::Or(goes_on, holds(g.ready)));
    each(hn::AndNot(goes_on, over), [&](std::size_t k) { scatter(t, g, k); });
  }

  // Draws a crossing in the part at work, given that one is expected `ons` + `offs` times at most: its time evenly,
  // accepted by the density there, then the noise at it by its slope. The first part then ends at the crossing. False
  // if there is none.
  bool propose(const IntervalTimes& t, ActiveLanes& g, std::size_t k, float ons, float offs) {
    // In search for a crossing before a candidate, any is enough.
    const auto next = [&] { return sensor::uniform(g.random.next(k)); };
    const bool on = next() * (ons + offs) < ons;
    const double u = next(), most = on ? ons : offs, sign = on ? 1 : -1;
    const float z = g.from[k] + static_cast<float>(u) * (g.to[k] - g.from[k]);
    const double length = (g.s1[k] - g.s0[k]) * (g.to[k] - g.from[k]);
    const NoiseCrossing crossing{.x = g.rate[k] * length,
                                 .y = t.amplifier.x * length,
                                 .u = u,
                                 .start = {g.n0[k], g.z0[k]},
                                 .end = {g.n1[k], g.z1[k]},
                                 .std_of_n = g.std[k],
                                 .sign = sign};
    const Cubic<float> q{g.q[0][k], g.q[1][k], g.q[2][k], g.q[3][k]};
    const double level = (on ? g.reference[k] + g.on[k] : g.reference[k] - g.off[k]) - q.at(z);
    const double slope = q.slope(z) * (g.to[k] - g.from[k]);
    const std::optional<NoiseState<double>> noise = crossing.draw(level, slope, most, next);
    if (!noise) return false;
    if (g.candidate[k] != 0) {
      reject_candidate(g, k);
      return false;
    }
    const std::uint32_t top = g.later[k]++;
    g.later_to[top][k] = std::exchange(g.to[k], z);
    g.later_n[top][k] = std::exchange(g.n1[k], static_cast<float>(noise->n));
    g.later_z[top][k] = std::exchange(g.z1[k], static_cast<float>(noise->z));
    g.candidate[k] = static_cast<float>(sign);
    g.candidate_later[k] = g.later[k];
    g.gate[k] = kNoGate;
    return true;
  }
  // A crossing precedes the candidate: the part that it was drawn for has none. The next part is that after it.
  static void reject_candidate(ActiveLanes& g, std::size_t k) {
    g.candidate[k] = 0;
    const std::uint32_t top = g.later[k] = g.candidate_later[k] - 1;
    g.to[k] = g.later_to[top][k], g.n1[k] = g.later_n[top][k], g.z1[k] = g.later_z[top][k];
  }

  // Finds the first crossings in the leaves and emits them. Pixels wake there at the end of their refractory period.
  HWY_NOINLINE void solve(const IntervalTimes& t, ActiveLanes& g) {
    const F f;
    const V one = hn::Set(f, 1.0f), zero = hn::Zero(f);
    M leaf = holds(g.leaf);
    set(g.leaf, zero);
    const V end = time_of(g, get(g.to)), latest = hn::Min(end, get(g.wakes_before)), blind = get(g.blind);
    const M blinded = hn::And(leaf, hn::Gt(blind, zero)), wakes = hn::AndNot(hn::Ge(blind, latest), blinded);
    M done = hn::AndNot(wakes, blinded);
    if (!hn::AllFalse(f, wakes)) {
      const V begin = time_of(g, get(g.from)), u = hn::Max(zero, hn::Div(hn::Sub(blind, begin), hn::Sub(end, begin)));
      set(g.blind, hn::IfThenZeroElse(wakes, blind));
      restart(t, g, wakes, u);
    }
    leaf = hn::AndNot(done, leaf);
    const Cubic<V> noise = noise_of(t, g), v = part_of(g) + noise;
    const V reference = get(g.reference);
    const Crossing<V> crossing = first_crossing(v, zero, hn::Sub(reference, get(g.off)), hn::Add(reference, get(g.on)));
    set(g.next, crossing.at);
    set(g.next_on, crossing.on);
    M by_noise = hn::Lt(one, zero);
    const M background = hn::And(leaf, hn::Lt(get(g.background), one));
    if (!hn::AllFalse(f, background)) by_noise = due_.background_first(t, g, background);
    if (is_noisy_ && !hn::AllFalse(f, hn::Gt(hn::Abs(get(g.candidate)), zero))) {
      const M counts = check_candidates(g, leaf);
      done = hn::Or(done, hn::AndNot(counts, leaf));
      leaf = counts;
    }
    const V u = get(g.next);
    const M fires = hn::And(leaf, hn::Le(u, one));
    done = hn::Or(done, hn::AndNot(fires, leaf));
    if (!hn::AllFalse(f, fires)) {
      const V from = get(g.from), s = time_of(g, hn::MulAdd(u, hn::Sub(get(g.to), from), from));
      output_.emit(t, g, fires, by_noise, s, noise.at(u));
      // The reference is V when the refractory period ends.
      const V refractory = hn::Mul(hn::Set(f, static_cast<float>(a_.constants.refractory_us)), hn::Set(f, t.per_h));
      const V until = hn::Add(s, refractory), begin = time_of(g, from);
      const M rests = hn::Gt(refractory, zero), sleeps = hn::And(fires, hn::And(rests, hn::Ge(until, latest)));
      const M resets = hn::AndNot(sleeps, fires);
      set(g.blind, hn::IfThenElse(sleeps, until, get(g.blind)));
      done = hn::Or(done, sleeps);
      if (!hn::AllFalse(f, resets)) {
        restart(t, g, resets, hn::IfThenElse(rests, hn::Div(hn::Sub(until, begin), hn::Sub(end, begin)), u));
        set(g.leaf, hn::Or(resets, holds(g.leaf)));
      }
    }
    next_part(t, g, done);
  }

  // The noise in a leaf, a cubic by its values and slopes at the ends: the mean between them. 0 without noise.
  HWY_INLINE Cubic<V> noise_of(const IntervalTimes& t, const ActiveLanes& g) const {
    const V zero = hn::Zero(F());
    if (!is_noisy_) return {zero, zero, zero, zero};
    const V n0 = get(g.n0), n1 = get(g.n1), z0 = get(g.z0), z1 = get(g.z1), y = leaf_y(t, g);
    return hermite(z0, z1, hn::Mul(y, hn::Sub(n0, z0)), hn::Mul(y, hn::Sub(n1, z1)));
  }
  // In long leaves noise is negligible, and relaxes within them.
  HWY_INLINE V leaf_y(const IntervalTimes& t, const ActiveLanes& g) const {
    const V length = hn::Mul(hn::Sub(get(g.s1), get(g.s0)), hn::Sub(get(g.to), get(g.from)));
    return hn::Min(hn::Set(F(), 3.0f), hn::Mul(hn::Set(F(), t.amplifier.x), length));
  }
  // The part begins at u of the leaf.
  HWY_INLINE void restart(const IntervalTimes& t, ActiveLanes& g, M which, V u) {
    const Cubic<V> noise = noise_of(t, g), v = part_of(g) + noise;
    const V from = get(g.from), z = hn::MulAdd(u, hn::Sub(get(g.to), from), from), noise_at_u = noise.at(u);
    begin_at(t, g, which, z, v.at(u), {hn::Add(noise_at_u, hn::Div(noise.slope(u), leaf_y(t, g))), noise_at_u});
  }

  // A crossing before a candidate ends the search for it; at the part that ends with it, it is one. Returns the lanes
  // whose crossings count.
  M check_candidates(ActiveLanes& g, M leaf) {
    HWY_ALIGN float counts[kLanes];
    set(counts, leaf);
    each(leaf, [&](std::size_t k) {
      if (g.candidate[k] == 0) return;
      if (g.later[k] == g.candidate_later[k]) {
        if (g.next[k] > 1) g.next[k] = 1, g.next_on[k] = g.candidate[k] > 0;
        g.candidate[k] = 0;
      } else if (g.next[k] <= 1) {
        reject_candidate(g, k);
        counts[k] = 0;
      }
    });
    return holds(counts);
  }

  const KernelArguments& a_;
  BlockRows& rows_;
  EventOutput output_;
  DueEvents due_;
  bool is_noisy_;
  std::uint32_t jobs_[BlockRows::kPixels + 2 * kLanes];
  std::size_t jobs_count_ = 0;
  std::size_t next_job_ = 0;
  ActiveLanes groups_[4];
};

}  // namespace pecs::sensor::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif
