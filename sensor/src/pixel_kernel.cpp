// Included once per instruction set by Highway's foreach_target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "pixel_kernel.cpp"
#include <hwy/foreach_target.h>
// then
#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>

#include "pecs/sensor/random.h"
#include "pixel_kernel.h"
#include "pixel_math-inl.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::sensor::HWY_NAMESPACE {

// (1 - e^-x) / x for x >= 0.
HWY_INLINE V phi1(V x) {
  const F f;
  V series = hn::Set(f, 1.0f / 5040);
  for (const float c : {-1.0f / 720, 1.0f / 120, -1.0f / 24, 1.0f / 6, -0.5f, 1.0f})
    series = hn::MulAdd(series, x, hn::Set(f, c));
  const M small = hn::Lt(x, hn::Set(f, 0.5f));
  if (hn::AllTrue(f, small)) return series;
  const V exact = hn::Div(hn::Sub(hn::Set(f, 1.0f), hn::Exp(f, hn::Neg(x))), x);
  return hn::IfThenElse(small, series, exact);
}

// photoreceptor.h: receptor_step; also gives e^-x.
HWY_INLINE V receptor_step(V w, V g0, V g1, V x, V& e) {
  const V one = hn::Set(F(), 1.0f);
  const V phi = phi1(x);
  e = hn::NegMulAdd(x, phi, one);
  return hn::MulAdd(hn::Sub(g1, g0), hn::Sub(one, phi), hn::MulAdd(e, hn::Sub(w, g0), g0));
}

// High and low halves of the products of 32-bit lanes.
HWY_INLINE void multiply(VU a, VU b, VU& high, VU& low) {
  const U32 u;
  const auto even = hn::MulEven(a, b);
  const auto odd = hn::MulEven(hn::ShiftRightLanes<1>(u, a), hn::ShiftRightLanes<1>(u, b));
  high = hn::OddEven(hn::BitCast(u, odd), hn::ShiftRightLanes<1>(u, hn::BitCast(u, even)));
  low = hn::Mul(a, b);
}

// random.h: random4 for a run of pixels.
HWY_INLINE void philox(VU c[4], std::uint64_t key) {
  const U32 u;
  auto k0 = static_cast<std::uint32_t>(key), k1 = static_cast<std::uint32_t>(key >> 32);
  for (int round = 0; round < 7; ++round) {
    VU ah, al, bh, bl;
    multiply(c[0], hn::Set(u, 0xD2511F53u), ah, al);
    multiply(c[2], hn::Set(u, 0xCD9E8D57u), bh, bl);
    c[0] = hn::Xor(hn::Xor(bh, c[1]), hn::Set(u, k0));
    c[2] = hn::Xor(hn::Xor(ah, c[3]), hn::Set(u, k1));
    c[1] = bl;
    c[3] = al;
    k0 += 0x9E3779B9;
    k1 += 0xBB67AE85;
  }
}

// random.h: gaussian.
HWY_INLINE V gaussian(VU r) {
  const F f;
  const I32 i;
  const V x = hn::MulAdd(hn::ConvertTo(f, hn::BitCast(i, hn::Xor(r, hn::Set(U32(), 0x80000000u)))),
                         hn::Set(f, 0x1p-31f), hn::Set(f, 0x1p-32f));
  const V one = hn::Set(f, 1.0f);
  const V inside = hn::Max(hn::Mul(hn::Sub(one, x), hn::Add(one, x)), hn::Set(f, 0x1p-26f));
  const V w = hn::Neg(ln(inside));
  const V central = hn::Sub(w, hn::Set(f, 2.5f));
  V p = hn::Set(f, 2.81022636e-08f);
  for (const float c : {3.43273939e-07f, -3.5233877e-06f, -4.39150654e-06f, 0.00021858087f, -0.00125372503f,
                        -0.00417768164f, 0.246640727f, 1.50140941f})
    p = hn::MulAdd(p, central, hn::Set(f, c));
  const M tail = hn::Ge(w, hn::Set(f, 5.0f));
  if (!hn::AllFalse(f, tail)) {
    const V far = hn::Sub(hn::Sqrt(w), hn::Set(f, 3.0f));
    V q = hn::Set(f, -0.000200214257f);
    for (const float c : {0.000100950558f, 0.00134934322f, -0.00367342844f, 0.00573950773f, -0.0076224613f,
                          0.00943887047f, 1.00167406f, 2.83297682f})
      q = hn::MulAdd(q, far, hn::Set(f, c));
    p = hn::IfThenElse(tail, q, p);
  }
  return hn::Mul(hn::Mul(p, x), hn::Set(f, 1.41421356f));
}

struct Vectors {
  V l0, l1, m0, reference, blind, w, noise;
};

template <bool kReceptor>
class Run {
 public:
  Run(const KernelArguments& a, std::uint32_t pixel, std::uint32_t lanes) : a_(a), pixel_(pixel), lanes_(lanes) {}

  // All planes of the batch for one vector of pixels; values: one vector per plane. background: by time.
  void operator()(const float* values, std::span<const BackgroundEvent> background) {
    on_ = hn::LoadU(f_, a_.threshold_on + pixel_);
    off_ = hn::Neg(hn::LoadU(f_, a_.threshold_off + pixel_));
    background_ = background;
    load();
    std::size_t interval = 0;
    for (std::size_t i = 0; i < a_.planes.size(); ++i) {
      const std::int64_t frame = a_.first_frame + static_cast<std::int64_t>(i);
      const V value = hn::LoadU(f_, values + i * Block::kStride);
      const V l2 = ln_current(a_, value, frame == 0 ? hn::Set(f_, std::log(kFloor_fa)) : s_.l1);
      if (frame == 0) {
        start(l2);
        if (a_.marks) mark_start();
      } else if (frame == 1) {
        s_.l0 = s_.l1;
        s_.l1 = l2;
      } else {
        const IntervalTimes& t = a_.intervals[interval++];
        const V s0 = hn::Mul(hn::Sub(s_.l1, s_.l0), hn::Set(f_, t.per_h));
        const V s1 = hn::Mul(hn::Sub(l2, s_.l1), hn::Set(f_, t.per_next));
        if (frame == 2) s_.m0 = end_slope(s0, s1, t.h_us, 1 / t.per_next);
        step(t, inner_slope(s0, s1, t));
        s_.l0 = s_.l1;
        s_.l1 = l2;
      }
    }
    if (a_.last && interval < a_.intervals.size()) {
      const IntervalTimes& t = a_.intervals[interval];
      const V s0 = hn::Mul(hn::Sub(s_.l1, s_.l0), hn::Set(f_, t.per_h));
      // No frame follows: the chord is the slope at the end.
      if (t.step == 0) s_.m0 = s0;
      step(t, s0);
    }
    store();
  }

 private:
  void load() {
    s_.l0 = hn::LoadU(f_, a_.l0 + pixel_);
    s_.l1 = hn::LoadU(f_, a_.l1 + pixel_);
    s_.m0 = hn::LoadU(f_, a_.m0 + pixel_);
    s_.reference = hn::LoadU(f_, a_.reference + pixel_);
    s_.blind = hn::LoadU(f_, a_.blind_us + pixel_);
    if constexpr (kReceptor) {
      s_.w = hn::LoadU(f_, a_.w + pixel_);
      s_.noise = hn::LoadU(f_, a_.noise + pixel_);
      at_state();
    }
  }
  // What follows from w and ln I.
  void at_state() {
    const V one = hn::Set(f_, 1.0f);
    v_ = hn::Neg(ln(s_.w));
    u_now_ = hn::Div(one, s_.w);
    i_now_ = hn::Exp(f_, s_.l0);
    g_now_ = hn::Div(one, i_now_);
  }
  void store() {
    const auto put = [&](V v, float* to) { store_lanes(v, lanes_, to); };
    put(s_.l0, a_.l0 + pixel_);
    put(s_.l1, a_.l1 + pixel_);
    put(s_.m0, a_.m0 + pixel_);
    put(s_.reference, a_.reference + pixel_);
    put(s_.blind, a_.blind_us + pixel_);
    if constexpr (kReceptor) {
      put(s_.w, a_.w + pixel_);
      put(s_.noise, a_.noise + pixel_);
    }
  }

  // The first frame: everything at rest.
  void start(V l) {
    s_.l0 = s_.l1 = l;
    s_.m0 = s_.blind = hn::Zero(f_);
    s_.reference = l;
    if constexpr (kReceptor) {
      s_.w = hn::Div(hn::Set(f_, 1.0f), hn::Exp(f_, l));
      s_.noise = hn::Zero(f_);
      at_state();
      if (a_.noise_std > 0) s_.noise = hn::Mul(hn::Set(f_, a_.noise_std), gaussian_of(0, Purpose::noise_start));
      s_.reference = hn::Add(v_, s_.noise);
    }
  }

  void mark_start() {
    HWY_ALIGN float noise[HWY_MAX_BYTES / sizeof(float)];
    hn::Store(kReceptor ? s_.noise : hn::Zero(f_), f_, noise);
    for (std::uint32_t i = 0; i < lanes_; ++i) a_.marks[pixel_ + i] = {a_.start_us, noise[i]};
  }

  // Four steps share one call of Philox.
  V gaussian_of(std::int64_t step, Purpose purpose) {
    const std::int64_t four = step >> 2;
    if (four != random_of_ || purpose != random_for_) {
      const auto s = static_cast<std::uint64_t>(four);
      random_[0] = hn::Iota(u_, pixel_);
      random_[1] = hn::Set(u_, static_cast<std::uint32_t>(s));
      random_[2] = hn::Set(u_, static_cast<std::uint32_t>(s >> 32));
      random_[3] = hn::Set(u_, static_cast<std::uint32_t>(purpose));
      philox(random_, a_.seed);
      random_of_ = four;
      random_for_ = purpose;
    }
    return gaussian(random_[step & 3]);
  }

  // The interval between frames of ln I = l0 and l1, with slopes m0 and m1 per us.
  void step(const IntervalTimes& t, V m1) {
    const V h = hn::Set(f_, t.h_us);
    if constexpr (kReceptor) {
      step_receptor(t, hn::Mul(s_.m0, h), hn::Mul(m1, h));
    } else {
      step_ideal(t, hn::Mul(s_.m0, h), hn::Mul(m1, h));
    }
    s_.m0 = m1;
  }

  // V = ln I, monotone between frames: its end tells whether a threshold is crossed.
  void step_ideal(const IntervalTimes& t, V m0, V m1) {
    const V leak = hn::Set(f_, static_cast<float>(a_.constants.leak_per_us) * t.h_us);
    const V d1 = hn::Sub(s_.l1, s_.reference);
    M active = hn::Or(hn::Ge(hn::Add(d1, leak), on_), hn::Le(d1, off_));
    active = hn::Or(active, hn::Gt(s_.blind, hn::Zero(f_)));
    find(t, active, m0, m1, s_.w, s_.noise);
    s_.reference = hn::Sub(s_.reference, leak);
  }

  // The photoreceptor over an interval whose light is given at its start, middle and end.
  struct Response {
    V w1, v1, u1, i1, g1;
    V x, decay;  // exposure and e^-X
  };
  Response respond(V m0, V m1, V a_h) const {
    const V one = hn::Set(f_, 1.0f), zero = hn::Zero(f_);
    // ln I at the middle of the cubic, and I at middle and end.
    const V lm = hn::MulAdd(hn::Sub(m0, m1), hn::Set(f_, 0.125f), hn::Mul(hn::Set(f_, 0.5f), hn::Add(s_.l0, s_.l1)));
    const V im = hn::Exp(f_, lm), i1 = hn::Exp(f_, s_.l1);
    const V gm = hn::Div(one, im), g1 = hn::Div(one, i1);
    // Two half steps.
    const V d = hn::Mul(a_h, hn::Set(f_, 1.0f / 24));
    const V x0 =
        hn::Max(zero, hn::Mul(d, hn::Sub(hn::MulAdd(hn::Set(f_, 5.0f), i_now_, hn::Mul(hn::Set(f_, 8.0f), im)), i1)));
    const V x1 =
        hn::Max(zero, hn::Mul(d, hn::Sub(hn::MulAdd(hn::Set(f_, 5.0f), i1, hn::Mul(hn::Set(f_, 8.0f), im)), i_now_)));
    V e0, e1;
    const V wm = receptor_step(s_.w, g_now_, gm, x0, e0);
    const V w1 = receptor_step(wm, gm, g1, x1, e1);
    return {w1, hn::Neg(ln(w1)), hn::Div(one, w1), i1, g1, hn::Add(x0, x1), hn::Mul(e0, e1)};
  }

  void step_receptor(const IntervalTimes& t, V m0, V m1) {
    const V a_h = hn::Set(f_, static_cast<float>(a_.constants.a_per_us) * t.h_us);
    const V one = hn::Set(f_, 1.0f);
    // Fixed seeds repeat still parts of a picture exactly: there everything but the noise is as one interval before.
    const V zero = hn::Zero(f_);
    const M still =
        hn::And(hn::And(hn::Eq(s_.l0, s_.l1), hn::Eq(s_.w, g_now_)), hn::And(hn::Eq(m0, zero), hn::Eq(m1, zero)));
    const bool all_still = hn::AllTrue(f_, still);
    if (!all_still || still_h_us_ != t.h_us) {
      r_ = respond(m0, m1, a_h);
      // Noise: an Ornstein-Uhlenbeck process of rate a u. Because dV/dt = a (I - u), its exposure is X - (V1 - V0), so
      // the correlation over the step is e^-X u1/u0.
      rho_ = hn::Min(one, hn::Mul(r_.decay, hn::Div(s_.w, r_.w1)));
      sigma_ = hn::Mul(hn::Set(f_, a_.noise_std), hn::Sqrt(hn::Mul(hn::Sub(one, rho_), hn::Add(one, rho_))));
      still_h_us_ = all_still ? t.h_us : 0;
    }
    V w1 = r_.w1, v1 = r_.v1, u1 = r_.u1;
    V n1 = s_.noise;
    if (a_.noise_std > 0) n1 = hn::MulAdd(sigma_, gaussian_of(t.step, Purpose::noise), hn::Mul(rho_, s_.noise));

    // V over the interval lies within the hull of its Bezier points.
    const V drift = hn::Add(hn::Sub(n1, s_.noise), hn::Set(f_, static_cast<float>(a_.constants.leak_per_us) * t.h_us));
    const V d0 = hn::Sub(hn::Add(v_, s_.noise), s_.reference);
    const V d1 = hn::Add(hn::Sub(hn::Add(v1, s_.noise), s_.reference), drift);
    const V third = hn::Set(f_, 1.0f / 3);
    const V slope0 = hn::MulAdd(a_h, hn::Sub(i_now_, u_now_), drift);
    const V slope1 = hn::MulAdd(a_h, hn::Sub(r_.i1, u1), drift);
    const V b0 = hn::MulAdd(third, slope0, d0), b1 = hn::NegMulAdd(third, slope1, d1);
    const V high = hn::Max(hn::Max(d0, d1), hn::Max(b0, b1)), low = hn::Min(hn::Min(d0, d1), hn::Min(b0, b1));
    M active = hn::Or(hn::Ge(high, on_), hn::Le(low, off_));
    active = hn::Or(active, hn::Gt(s_.blind, zero));
    // Fast light needs shorter steps than two.
    const V dl = hn::Sub(s_.l1, s_.l0);
    active = hn::Or(active, hn::Gt(hn::Mul(hn::Mul(dl, dl), hn::Min(one, r_.x)), hn::Set(f_, 0.02f)));

    if (find(t, active, m0, m1, w1, n1)) {
      v1 = hn::Neg(ln(w1));
      u1 = hn::Div(one, w1);
    }
    s_.reference = hn::Sub(s_.reference, hn::Set(f_, static_cast<float>(a_.constants.leak_per_us) * t.h_us));
    v_ = v1;
    u_now_ = u1;
    i_now_ = r_.i1;
    g_now_ = r_.g1;
    s_.w = w1;
    s_.noise = n1;
  }

  // Exact work for the lanes that may have events; false when there are none.
  bool find(const IntervalTimes& t, M active, V m0, V m1, V& w1, V& n1) {
    const bool noise_now = !background_.empty() && background_.front().t_us < t.t1_us;
    if (HWY_LIKELY(!noise_now && hn::AllFalse(f_, active))) return false;
    find_slowly(t, active, m0, m1, w1, n1);
    return true;
  }

  HWY_NOINLINE void find_slowly(const IntervalTimes& t, M active, V m0, V m1, V& w1, V& n1) {
    constexpr std::size_t kLanes = HWY_MAX_BYTES / sizeof(float);
    HWY_ALIGN float flag[kLanes], fl0[kLanes], fl1[kLanes], fm0[kLanes], fm1[kLanes], fw0[kLanes], fw1[kLanes],
        fn0[kLanes], fn1[kLanes], fon[kLanes], foff[kLanes], fref[kLanes], fblind[kLanes];
    hn::Store(hn::IfThenElseZero(active, hn::Set(f_, 1.0f)), f_, flag);
    hn::Store(s_.l0, f_, fl0);
    hn::Store(s_.l1, f_, fl1);
    hn::Store(m0, f_, fm0);
    hn::Store(m1, f_, fm1);
    hn::Store(on_, f_, fon);
    hn::Store(off_, f_, foff);
    hn::Store(s_.reference, f_, fref);
    hn::Store(s_.blind, f_, fblind);
    for (std::size_t i = 0; i < kLanes; ++i) fw0[i] = fw1[i] = fn0[i] = fn1[i] = 0;
    if constexpr (kReceptor) {
      hn::Store(s_.w, f_, fw0);
      hn::Store(w1, f_, fw1);
      hn::Store(s_.noise, f_, fn0);
      hn::Store(n1, f_, fn1);
    }
    // Background events of this interval: time order, all lanes mixed.
    std::size_t due = 0;
    while (due < background_.size() && background_[due].t_us < t.t1_us) flag[background_[due++].pixel - pixel_] = 1;
    const auto now = background_.first(due);
    background_ = background_.subspan(due);
    std::vector<BackgroundEvent> own;
    const float leak = static_cast<float>(a_.constants.leak_per_us) * t.h_us;
    for (std::uint32_t i = 0; i < lanes_; ++i) {
      if (flag[i] == 0) continue;
      own.clear();
      for (const BackgroundEvent& e : now)
        if (e.pixel == pixel_ + i) own.push_back(e);
      PixelInterval p{t.t0_us,
                      t.t1_us - t.t0_us,
                      pixel_ + i,
                      fl0[i],
                      fl1[i],
                      fm0[i],
                      fm1[i],
                      fw0[i],
                      fw1[i],
                      fn0[i],
                      fn1[i],
                      fon[i],
                      -foff[i],
                      fref[i],
                      fblind[i],
                      own,
                      a_.marks ? a_.marks + pixel_ + i : nullptr};
      find_events(a_.constants, p, *a_.events);
      fref[i] = static_cast<float>(p.reference) + leak;  // the caller takes it off for all lanes
      fblind[i] = static_cast<float>(p.blind_us);
      fw1[i] = static_cast<float>(p.w1);
    }
    s_.reference = hn::Load(f_, fref);
    s_.blind = hn::Load(f_, fblind);
    if constexpr (kReceptor) w1 = hn::Load(f_, fw1);
  }

  const F f_{};
  const U32 u_{};
  const KernelArguments& a_;
  const std::uint32_t pixel_, lanes_;
  Vectors s_{};
  V on_{}, off_{};
  V v_{}, u_now_{}, i_now_{}, g_now_{};  // at the start of the interval
  Response r_{};
  V rho_{}, sigma_{};     // of the noise over the interval
  float still_h_us_ = 0;  // > 0: r_, rho_ and sigma_ hold for all lanes while still, in intervals of this length
  VU random_[4]{};
  std::int64_t random_of_ = -1;
  Purpose random_for_ = Purpose::threshold;
  std::span<const BackgroundEvent> background_;
};

template <bool kReceptor>
void run_all(const KernelArguments& a) {
  const auto lanes = static_cast<std::uint32_t>(hn::Lanes(F()));
  const auto end = a.first + a.count;
  auto background = a.background;
  Block values(a);
  std::vector<BackgroundEvent> by_time;
  for (std::uint32_t block = a.first; block < end; block += Block::kPixels) {
    const std::uint32_t block_end = std::min(end, block + Block::kPixels);
    values.gather(block, block_end, a.planes.size());
    for (std::uint32_t pixel = block; pixel < block_end; pixel += lanes) {
      std::size_t mine = 0;
      while (mine < background.size() && background[mine].pixel < pixel + lanes) ++mine;
      by_time.assign(background.begin(), background.begin() + static_cast<std::ptrdiff_t>(mine));
      background = background.subspan(mine);
      if (mine > 1) std::ranges::stable_sort(by_time, {}, &BackgroundEvent::t_us);
      Run<kReceptor> run(a, pixel, std::min(lanes, block_end - pixel));
      run(values.from(pixel - block), by_time);
    }
  }
}

void RunKernel(const KernelArguments& a) {
  if (a.constants.a_per_us > 0)
    run_all<true>(a);
  else
    run_all<false>(a);
}

}  // namespace pecs::sensor::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace pecs::sensor {
HWY_EXPORT(RunKernel);
void run_kernel(const KernelArguments& arguments) { HWY_DYNAMIC_DISPATCH(RunKernel)(arguments); }
}  // namespace pecs::sensor
#endif
