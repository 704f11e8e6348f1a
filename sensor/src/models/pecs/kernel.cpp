// Included once per instruction set by Highway's foreach_target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "models/pecs/kernel.cpp"
#include <hwy/foreach_target.h>
// then
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <vector>

#include "models/pecs/active_pixels-inl.h"
#include "models/pecs/kernel.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::sensor::HWY_NAMESPACE {

// A block of pixels, frame by frame. First the work for all pixels, vector by vector; then the exact work, for those
// that may fire. Most of a picture is constant in time: results that depend on constant light alone are kept.
template <bool kReceptor, bool kAmplifier>
class PixelBlock {
 public:
  static constexpr std::uint32_t kPixels = BlockRows::kPixels;

  explicit PixelBlock(const KernelArguments& a)
      : a_(a), planes_(a), active_(a, rows_), is_noisy_(kAmplifier && a.noise_std > 0) {}

  // background: of these pixels, by time.
  void run(std::uint32_t first, std::uint32_t end, std::span<const BackgroundEvent> background) {
    rows_.first = first;
    rows_.count = end - first;
    vectors_end_ = (rows_.count + lanes() - 1) / lanes() * lanes();
    active_.begin(background);
    load();
    planes_.begin(first, rows_.count);
    std::size_t interval = 0;
    for (std::size_t i = 0; i < a_.planes.size(); ++i) {
      const std::int64_t frame = a_.first_frame + static_cast<std::int64_t>(i);
      take_light(frame == 0);
      if (frame == 0) start();
      if (frame == 1 && a_.random_phase) draw_phases();
      if (frame > 1) {
        const IntervalTimes& t = a_.intervals[interval++];
        list_moving(t);
        for (std::size_t k = 0; k < moving_count_; ++k) {
          const std::uint32_t p = moving_[k];
          const V l0 = at(rows_.l[0], p), l1 = at(rows_.l[1], p), l2 = at(rows_.l[2], p);
          const V s0 = per(l0, l1, t.per_h), s1 = per(l1, l2, t.per_next);
          if (frame == 2) put(end_slope(s0, s1, t.h_us, 1 / t.per_next), rows_.m[0], p);
          put(inner_slope(s0, s1, at(rows_.m[0], p), t.slope), rows_.m[1], p);
        }
        step(t);
      }
      for (float** row : {rows_.l, rows_.i, rows_.g}) {
        float* oldest = row[0];
        row[0] = row[1], row[1] = row[2], row[2] = oldest;
      }
    }
    if (a_.last && interval < a_.intervals.size()) {
      const IntervalTimes& t = a_.intervals[interval];
      moving_count_ = quiet_count_ = 0;
      for (std::uint32_t p = 0; p < vectors_end_; p += lanes()) {
        moving_[moving_count_++] = p;
        // No frame follows: the chord is the slope at the end.
        const V s0 = per(at(rows_.l[0], p), at(rows_.l[1], p), t.per_h);
        if (t.step == 0) put(s0, rows_.m[0], p);
        put(s0, rows_.m[1], p);
      }
      step(t);
    }
    store();
  }

 private:
  static HWY_INLINE V per(V from, V to, float per_us) { return hn::Mul(hn::Sub(to, from), hn::Set(F(), per_us)); }
  static HWY_INLINE V inverse(V v) { return hn::Div(hn::Set(F(), 1.0f), v); }
  void load() {
    const auto take = [&](const float* from, float* row, float beyond) {
      std::fill_n(std::copy_n(from + rows_.first, rows_.count, row), vectors_end_ - rows_.count, beyond);
    };
    take(a_.light0, rows_.i[0], 1);
    take(a_.light1, rows_.i[1], 1);
    take(a_.m0, rows_.m[0], 0);
    take(a_.reference, rows_.reference, 0);
    take(a_.blind_us, rows_.blind_us, 0);
    if (a_.equal_thresholds) {
      std::fill_n(rows_.on, kPixels, *a_.threshold_on);
      std::fill_n(rows_.off, kPixels, *a_.threshold_off);
    } else {
      take(a_.threshold_on, rows_.on, 1);
      take(a_.threshold_off, rows_.off, 1);
    }
    if constexpr (kReceptor) {
      take(a_.w, rows_.w[0], 1);
      if constexpr (kAmplifier) take(a_.y, rows_.y[0], 0);
    }
    if (a_.e) take(a_.e, rows_.e[0], 0);
    if (is_noisy_) {
      take(a_.n, rows_.n[0], 0);
      take(a_.z, rows_.z[0], 0);
    }
    for (std::uint32_t p = 0; p < vectors_end_; p += lanes()) {
      prefetch_state(rows_.first + BlockRows::kPixels + p);
      follow_light(0, p);
      follow_light_since(0, 1, p);
      if constexpr (kReceptor) follow_w(0, p);
    }
    std::ranges::fill(still_for_, std::uint8_t{0});
    kept_h_us_ = 0;
  }
  // Prefetches what load() will read for pixels from p on.
  void prefetch_state(std::uint32_t p) const {
    if (p >= a_.first + a_.count) return;
    for (const float* row : {a_.light0, a_.light1, a_.m0, a_.reference, a_.blind_us}) hwy::Prefetch(row + p);
    if (!a_.equal_thresholds)
      for (const float* row : {a_.threshold_on, a_.threshold_off}) hwy::Prefetch(row + p);
    if constexpr (kReceptor) hwy::Prefetch(a_.w + p);
    if constexpr (kAmplifier) hwy::Prefetch(a_.y + p);
    if (is_noisy_)
      for (const float* row : {a_.n, a_.z}) hwy::Prefetch(row + p);
  }
  void follow_light(int k, std::uint32_t p) {
    const V i = at(rows_.i[k], p);
    put(ln(i), rows_.l[k], p);
    put(inverse(i), rows_.g[k], p);
  }
  // follow_light, copied from frame `before` where the light is the same.
  void follow_light_since(int before, int k, std::uint32_t p) {
    if (!hn::AllTrue(F(), hn::Eq(at(rows_.i[before], p), at(rows_.i[k], p)))) return follow_light(k, p);
    put(at(rows_.l[before], p), rows_.l[k], p);
    put(at(rows_.g[before], p), rows_.g[k], p);
  }
  void follow_w(int k, std::uint32_t p) {
    const V w = at(rows_.w[k], p);
    put(hn::Neg(ln(w)), rows_.v[k], p);
    put(inverse(w), rows_.u[k], p);
  }
  void store() {
    // Writes only values that changed: most of the state is out of cache, and reading is cheaper than writing.
    const I32 i;
    const auto give = [&](const float* row, float* to) {
      to += rows_.first;
      std::uint32_t p = 0;
      for (; p + lanes() <= rows_.count; p += lanes()) {
        const auto now = hn::BitCast(i, at(row, p));
        if (!hn::AllTrue(i, hn::Eq(now, hn::BitCast(i, hn::LoadU(F(), to + p))))) hn::StoreU(at(row, p), F(), to + p);
      }
      std::copy(row + p, row + rows_.count, to + p);
    };
    give(rows_.i[0], a_.light0);
    give(rows_.i[1], a_.light1);
    give(rows_.m[0], a_.m0);
    give(rows_.reference, a_.reference);
    give(rows_.blind_us, a_.blind_us);
    if constexpr (kReceptor) {
      give(rows_.w[0], a_.w);
      if constexpr (kAmplifier) give(rows_.y[0], a_.y);
    }
    if (a_.e) give(rows_.e[0], a_.e);
    if (is_noisy_) {
      give(rows_.n[0], a_.n);
      give(rows_.z[0], a_.z);
    }
  }

  // Light of the next frame, where it differs from the one before.
  void take_light(bool first) {
    const F f;
    const float* now = planes_.next();
    for (std::size_t w = 0; w < planes_.words(); ++w) {
      // Rows rotate: the newest row holds the values of three planes ago.
      const std::uint64_t changed = planes_.changed(w), moving = planes_.changed(w, 1) | planes_.changed(w, 2);
      each_vector(~changed & moving, w, [&](std::uint32_t p) {
        for (float** row : {rows_.l, rows_.i, rows_.g}) put(at(row[1], p), row[2], p);
      });
      each_vector(changed, w, [&](std::uint32_t p) {
        V current;
        const M lit = current_of(a_, hn::LoadU(f, now + p), current);
        put(hn::IfThenElse(lit, current, first ? hn::Set(f, kDarkest_fa) : at(rows_.i[1], p)), rows_.i[2], p);
        follow_light_since(1, 2, p);
      });
    }
  }

  // The first frame, in the newest rows: steady state.
  void start() {
    const F f;
    for (std::uint32_t p = 0; p < vectors_end_; p += lanes()) {
      put(hn::Zero(f), rows_.m[0], p);
      put(hn::Zero(f), rows_.blind_us, p);
      put(at(rows_.l[2], p), rows_.reference, p);
      if constexpr (kReceptor) {
        put(at(rows_.g[2], p), rows_.w[0], p);
        follow_w(0, p);
        if constexpr (kAmplifier) put(at(rows_.v[0], p), rows_.y[0], p);
        V output = at(rows_.v[0], p);
        if (is_noisy_) {
          // The variance of z is b / (b + a I) of that of n, and so is the covariance.
          const Four random = draw(p, 0, Purpose::noise_start);
          const V b = hn::Set(f, static_cast<float>(a_.constants.b_per_us));
          const V share =
              hn::Div(b, hn::MulAdd(hn::Set(f, static_cast<float>(a_.constants.a_per_us)), at(rows_.i[2], p), b));
          const V n = hn::Mul(hn::Set(f, a_.noise_std), gaussian(random[0]));
          const V rest = hn::Mul(hn::Set(f, a_.noise_std), hn::Sqrt(hn::NegMulAdd(share, share, share)));
          const V z = hn::MulAdd(rest, gaussian(random[1]), hn::Mul(share, n));
          put(n, rows_.n[0], p);
          put(z, rows_.z[0], p);
          output = hn::Add(output, z);
        }
        put(output, rows_.reference, p);
      }
    }
    if (a_.marks)
      for (std::uint32_t p = 0; p < rows_.count; ++p)
        a_.marks[rows_.first + p] = {a_.start_us, is_noisy_ ? rows_.z[0][p] : 0.0f, 0.0f};
  }

  // Distances of the noise-free output from the reference, at the second frame: uniform over a threshold in the
  // direction that the light moves in, for light that has moved so before; in still light, in that of the leak, or
  // without a leak between both thresholds. Noise has fired whatever it reaches, and its reset lies as far on the other
  // side: the margin m is where Rice's formula (sensor.md, Amplifier) gives one crossing per second or, in light that
  // moves faster, so many that one is expected between m and the threshold: m v / std^2 per second at v per second. At
  // most 0.45 of a threshold.
  void draw_phases() {
    constexpr float kStill = 1e-6f;             // of ln I
    constexpr double kOrnsteinUhlenbeck = 1.6;  // crossings per r exp(-m^2 / 2), m / sqrt(2 pi) at m = 4
    const double a = a_.constants.a_per_us, b = a_.constants.b_per_us;
    const double per_us = a_.intervals.empty() ? 0 : a_.intervals.front().per_h;  // empty: a warm-up of two frames
    for (std::uint32_t p = 0; p < rows_.count; ++p) {
      const double r = a * rows_.i[1][p], on = rows_.on[p], off = rows_.off[p];
      const double per_s = 1e6 * (b > 0 ? std::sqrt(b * r) / (2 * std::numbers::pi) : kOrnsteinUhlenbeck * r);
      const double std = b > 0 ? a_.noise_std * std::sqrt(b / (b + r)) : a_.noise_std;
      const float change = rows_.l[2][p] - rows_.l[1][p];
      const double stds_per_s = 1e6 * std::abs(change) * per_us / std;
      double stds = std::sqrt(2 * std::log1p(per_s));
      for (int round = 0; round < 4; ++round)
        stds = std::sqrt(2 * std::log1p(per_s / std::max(1.0, stds * stds_per_s)));
      const double margin = std > 0 ? std::min(std * stds, 0.45 * std::min(on, off)) : 0;
      const bool falls = change<-kStill, rises = change> kStill || (!falls && a_.constants.leak_per_us > 0);
      const double low = rises ? -margin : margin - off, high = falls ? margin : on - margin;
      const Random4 drawn = random4(a_.seed, rows_.first + p, 1, Purpose::noise_start);
      const auto phase = static_cast<float>(low + sensor::uniform(drawn[0]) * (high - low));
      rows_.reference[p] -= phase + (is_noisy_ ? rows_.z[0][p] : 0.0f);
      if (a_.marks) a_.marks[rows_.first + p] = {a_.start_us, 0, phase};
    }
  }

  // Random numbers of a step.
  Four draw(std::uint32_t p, std::int64_t step, Purpose purpose) const {
    return random_of(iota(rows_.first + p), step, purpose, a_.noise_seed);
  }

  // Lists moving and quiet vectors. In quiet ones light and photoreceptor are constant, and the results that depend on
  // them are kept.
  void list_moving(const IntervalTimes& t) {
    moving_count_ = quiet_count_ = 0;
    for (std::uint32_t p = 0; p < vectors_end_; p += lanes()) {
      std::uint8_t& still_for = still_for_[p / lanes()];  // intervals, up to 2: then both rows of a pair are equal
      bool still = !planes_.moves(p);
      if constexpr (kReceptor) still = still && (still_for == 2 || is_settled(p));
      const bool is_kept = still_for > 0;
      if (!(still && still_for == 2)) {
        still_for = still ? still_for + 1 : 0;
        put(at(rows_.m[0], p), rows_.m[1], p);
        if constexpr (kReceptor) {
          put(at(rows_.w[0], p), rows_.w[1], p);
          put(at(rows_.v[0], p), rows_.v[1], p);
          put(at(rows_.u[0], p), rows_.u[1], p);
          if constexpr (kAmplifier) put(at(rows_.y[0], p), rows_.y[1], p);
        }
      }
      const bool is_quiet = still && is_kept && kept_h_us_ == t.h_us;
      moving_[moving_count_] = quiet_[quiet_count_] = p;
      moving_count_ += !is_quiet;
      quiet_count_ += is_quiet;
    }
    kept_h_us_ = t.h_us;
  }

  // Whether photoreceptor and amplifier are at rest in the light at the interval's start.
  HWY_INLINE bool is_settled(std::uint32_t p) const {
    const F f;
    M settled = hn::Eq(at(rows_.w[0], p), at(rows_.g[0], p));
    if constexpr (kAmplifier) settled = hn::And(settled, hn::Eq(at(rows_.y[0], p), at(rows_.v[0], p)));
    return hn::AllTrue(f, settled);
  }

  HWY_INLINE void respond(const IntervalTimes& t, std::uint32_t p) {
    const F f;
    const V i0 = at(rows_.i[0], p), i1 = at(rows_.i[1], p), g0 = at(rows_.g[0], p), w0 = at(rows_.w[0], p);
    const float a_h = a_h_of(a_, t);
    const bool is_still = hn::AllTrue(f, hn::Eq(i0, i1));
    const Response<V> r = is_still ? constant_half_steps(i0, g0, w0, a_h)
                                   : two_half_steps<V>({at(rows_.l[0], p), at(rows_.l[1], p), at(rows_.m[0], p),
                                                        at(rows_.m[1], p), i0, i1, g0, at(rows_.g[1], p)},
                                                       w0, t.h_us, a_h);
    put(r.w, rows_.w[1], p);
    const bool is_constant = is_still && hn::AllTrue(f, hn::Eq(w0, g0));  // the photoreceptor
    if (is_constant) {
      put(at(rows_.v[0], p), rows_.v[1], p);
      put(at(rows_.u[0], p), rows_.u[1], p);
    } else {
      follow_w(1, p);
    }
    if constexpr (kAmplifier) amplify(t, p, is_constant);
    if (is_noisy_) prepare_noise(t, p, r.exposure);
  }
  // The noise's law over the interval: one rate, as the light changes little (else: list()).
  HWY_INLINE void prepare_noise(const IntervalTimes& t, std::uint32_t p, V exposure) {
    const V x = relaxation_of(exposure, at(rows_.v[0], p), at(rows_.v[1], p), at(rows_.u[0], p), at(rows_.u[1], p),
                              hn::Set(F(), a_h_of(a_, t)));
    const V std = active_.noise_std_of(x, exposure);
    put(x, rows_.relaxation, p);
    put(std, rows_.noise_std, p);
    const NoiseStep<V> step = noise_step(x, hn::Set(F(), t.amplifier.x));
    const NoiseSpread<V> factor = factor_of(step.added);
    const V scale = hn::Mul(std, hn::Sqrt(hn::Add(x, x)));
    const NoiseReach<V> reach = noise_reach(x, step.y, std);
    const V kept[] = {step.e,
                      step.k,
                      hn::Mul(scale, factor.nn),
                      hn::Mul(scale, factor.nz),
                      hn::Mul(scale, factor.zz),
                      reach.std,
                      reach.slope_std,
                      reach.sag,
                      reach.over};
    for (std::size_t k = 0; k < kKept; ++k) put(kept[k], kept_[k], p);
  }
  HWY_INLINE void amplify(const IntervalTimes& t, std::uint32_t p, bool is_constant) {
    const F f;
    const V y0 = at(rows_.y[0], p), v0 = at(rows_.v[0], p), v1 = at(rows_.v[1], p), h = hn::Set(f, t.h_us);
    WholeSlope<V> at0{hn::Zero(f), hn::Zero(f)}, at1 = at0;
    if (!is_constant) {
      const auto slope = [&](int k) {
        return whole_slope(hn::Mul(at(rows_.m[k], p), h), a_h_of(a_, t), at(rows_.i[k], p), at(rows_.g[k], p),
                           at(rows_.u[k], p));
      };
      at0 = slope(0), at1 = slope(1);
    }
    const V y1 = amplified(y0, v0, v1, at0, at1, t.amplifier);
    const M settles = hn::Lt(hn::Abs(hn::Sub(y1, v1)), hn::Set(f, is_constant ? 2e-6f : 0.0f));
    put(hn::IfThenElse(settles, v1, y1), rows_.y[1], p);
  }

  // The interval between the frames of rows 0 and 1, with slopes rows_.m per us.
  void step(const IntervalTimes& t) {
    const F f;
    if constexpr (kReceptor)
      for (std::size_t k = 0; k < moving_count_; ++k) respond(t, moving_[k]);
    const float* v0_row = kAmplifier ? rows_.y[0] : kReceptor ? rows_.v[0] : rows_.l[0];
    const float* v1_row = kAmplifier ? rows_.y[1] : kReceptor ? rows_.v[1] : rows_.l[1];
    const V rate = hn::Set(f, a_h_of(a_, t)), leaks = hn::Set(f, t.leak);
    std::size_t jobs = 0, fast_jobs = 0;
    const auto list = [&](M which, std::uint32_t p, std::uint32_t* to, std::size_t& count) {
      const Compress compress(hn::And(which, hn::FirstN(f, std::min(lanes(), rows_.count - p))));
      compress.store(iota(p), to + count);
      count += compress.count();
    };
    // Pixels that may fire while the output without noise is between low and high, relative to the reference.
    const V slow = hn::Set(f, slow_h_of(a_, t)), stays = exp(hn::Neg(slow));
    const auto may_fire = [&](std::uint32_t p, V low, V high, V steepest) {
      if (a_.e) {
        const V e0 = at(rows_.e[0], p), e1 = hn::Mul(stays, e0);
        put(e1, rows_.e[1], p);
        low = hn::Add(low, hn::Min(e0, e1)), high = hn::Add(high, hn::Max(e0, e1));
        steepest = hn::MulAdd(slow, hn::Abs(e0), steepest);
      }
      const V to_on = hn::Sub(at(rows_.on, p), high), to_off = hn::Add(low, at(rows_.off, p));
      const M blind = hn::Gt(at(rows_.blind_us, p), hn::Zero(f));
      if (!is_noisy_) return hn::Or(blind, hn::Le(hn::Min(to_on, to_off), hn::Zero(f)));
      return noise_may_cross(t, p, to_on, to_off, steepest, blind);
    };
    for (std::size_t k = 0; k < moving_count_; ++k) {
      const std::uint32_t p = moving_[k];
      const V reference = at(rows_.reference, p);
      const V d0 = hn::Sub(at(v0_row, p), reference), d1 = hn::Add(hn::Sub(at(v1_row, p), reference), leaks);
      V high = hn::Max(d0, d1), low = hn::Min(d0, d1), steepest = hn::Abs(hn::Sub(d1, d0));
      M fast = hn::Lt(high, low);  // none
      if constexpr (!kReceptor)
        widen_to_hull(d0, d1, hn::Set(f, t.h_us), at(rows_.m[0], p), at(rows_.m[1], p), leaks, low, high);
      if constexpr (kReceptor) {
        const V i0 = at(rows_.i[0], p), i1 = at(rows_.i[1], p);
        if constexpr (kAmplifier) {
          const V b = hn::Set(f, t.amplifier.x);
          const V off0 = hn::Sub(at(rows_.v[0], p), at(rows_.y[0], p)),
                  off1 = hn::Sub(at(rows_.v[1], p), at(rows_.y[1], p));
          widen_to_hull(d0, d1, b, off0, off1, leaks, low, high);
          steepest = hn::Max(steepest, hn::Mul(b, hn::Max(hn::Abs(off0), hn::Abs(off1))));
        } else {
          widen_to_hull(d0, d1, rate, hn::Sub(i0, at(rows_.u[0], p)), hn::Sub(i1, at(rows_.u[1], p)), leaks, low, high);
        }
        // Fast light needs shorter steps than two.
        const V dl = hn::Sub(at(rows_.l[1], p), at(rows_.l[0], p));
        const V x = hn::Min(hn::Set(f, 1.0f), hn::Mul(hn::Mul(rate, hn::Set(f, 0.5f)), hn::Add(i0, i1)));
        fast = hn::Gt(hn::Mul(hn::Mul(dl, dl), x), hn::Set(f, 0.02f));
        if (is_noisy_) {  // the error of two half steps
          const V error = hn::Mul(hn::Set(f, 0.03f), hn::Abs(dl));
          low = hn::Sub(low, error), high = hn::Add(high, error);
        }
      }
      const M fires = may_fire(p, low, high, steepest);
      if (!hn::AllFalse(f, fast)) {
        list(fast, p, fast_, fast_jobs);
        if (is_noisy_) put(hn::IfThenElse(fast, hn::Set(f, kFree), at(rows_.gate, p)), rows_.gate, p);
      }
      list(hn::AndNot(fast, fires), p, active_.jobs(), jobs);
    }
    for (std::size_t k = 0; k < quiet_count_; ++k) {
      const std::uint32_t p = quiet_[k];
      const V d0 = hn::Sub(at(v0_row, p), at(rows_.reference, p)), d1 = hn::Add(d0, leaks);
      list(may_fire(p, hn::Min(d0, d1), hn::Max(d0, d1), leaks), p, active_.jobs(), jobs);
    }
    // Listed last: they need several steps and would stall vectors that need one.
    std::copy_n(fast_, fast_jobs, active_.jobs() + jobs);
    active_.work(t, jobs + fast_jobs);
    for (std::size_t k = 0; k < active_.worked(); ++k) still_for_[active_.jobs()[k] / lanes()] = 0;
    if (a_.constants.leak_per_us > 0)
      for (std::uint32_t p = 0; p < vectors_end_; p += lanes())
        put(hn::Sub(at(rows_.reference, p), leaks), rows_.reference, p);
    for (float** row : {rows_.m, rows_.w, rows_.v, rows_.u, rows_.y, rows_.n, rows_.z, rows_.e})
      std::swap(row[0], row[1]);
  }

  // The noise at the interval's end, and the pixels that are blind or whose output may cross a threshold on the way,
  // with their gates (ActivePixels::examine): those that few crossings are expected of are drawn.
  HWY_INLINE M noise_may_cross(const IntervalTimes& t, std::uint32_t p, V to_on, V to_off, V steepest, M blind) {
    const F f;
    const auto kept = [&](std::size_t k) { return at(kept_[k], p); };
    const NoiseState<V> s0{at(rows_.n[0], p), at(rows_.z[0], p)};
    const Four random = draw(p, t.step, Purpose::noise);
    const V g0 = gaussian(random[0]), g1 = gaussian(random[1]);
    const NoiseState<V> s1{
        hn::MulAdd(kept(2), g0, hn::Mul(kept(0), s0.n)),
        hn::MulAdd(kept(3), g0,
                   hn::MulAdd(kept(4), g1, hn::MulAdd(kept(1), s0.n, hn::Mul(hn::Set(f, t.amplifier.decay), s0.z))))};
    put(s1.n, rows_.n[1], p);
    put(s1.z, rows_.z[1], p);
    const NoiseReach<V> reach{kept(5), kept(6), kept(7), kept(8)};
    const auto bounds = reach.bounds(s0, s1);
    to_on = hn::Sub(to_on, bounds.above), to_off = hn::Add(to_off, bounds.below);
    const M far = hn::Gt(hn::Min(to_on, to_off), 7.0f * reach.std);
    if (hn::AllTrue(f, hn::AndNot(blind, far))) return hn::FirstN(f, 0);
    const V expected = hn::Add(most_crossings(to_on, steepest, reach), most_crossings(to_off, steepest, reach));
    const V gate = uniform(random[2]);
    const M many = hn::Or(blind, hn::Ge(expected, hn::Set(f, active_.kFewCrossings)));
    put(hn::IfThenElse(many, hn::Set(f, kNoGate), gate), rows_.gate, p);
    return hn::Or(many, hn::Lt(gate, expected));
  }

  const KernelArguments& a_;
  Planes<kPixels> planes_;
  BlockRows rows_;
  ActivePixels<kReceptor, kAmplifier> active_;
  bool is_noisy_;
  std::uint32_t vectors_end_ = 0;
  float kept_h_us_ = 0;
  std::size_t moving_count_ = 0, quiet_count_ = 0;
  static constexpr std::size_t kKept = 9;
  HWY_ALIGN float kept_[kKept][kPixels];  // prepare_noise
  std::uint8_t still_for_[kPixels];       // of a vector; while > 0, kept_ is valid
  std::uint32_t moving_[kPixels + 1], quiet_[kPixels + 1], fast_[kPixels + kLanes];
};

template <bool kReceptor, bool kAmplifier>
void run_all(const KernelArguments& a) {
  using Block = PixelBlock<kReceptor, kAmplifier>;
  const auto block = std::make_unique<Block>(a);
  const std::uint32_t end = a.first + a.count;
  auto background = a.background;
  std::vector<BackgroundEvent> by_time;
  for (std::uint32_t first = a.first; first < end; first += Block::kPixels) {
    const std::uint32_t block_end = std::min(end, first + Block::kPixels);
    const auto mine = std::ranges::lower_bound(background, block_end, {}, &BackgroundEvent::pixel);
    by_time.assign(background.begin(), mine);
    background = {mine, background.end()};
    std::ranges::stable_sort(by_time, {}, &BackgroundEvent::t_us);
    block->run(first, block_end, by_time);
  }
}

void RunKernel(const KernelArguments& a) {
  if (a.constants.b_per_us > 0)
    run_all<true, true>(a);
  else if (a.constants.a_per_us > 0)
    run_all<true, false>(a);
  else
    run_all<false, false>(a);
}

}  // namespace pecs::sensor::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace pecs::sensor {
HWY_EXPORT(RunKernel);
void run_kernel(const KernelArguments& arguments) { HWY_DYNAMIC_DISPATCH(RunKernel)(arguments); }
}  // namespace pecs::sensor
#endif
