// Pixels of thresholds alone (chip `ideal`): V = ln I. Included once per instruction set by Highway's foreach_target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "models/pecs/threshold_kernel.cpp"
#include <hwy/foreach_target.h>
// then
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "models/pecs/cubic-inl.h"
#include "models/pecs/kernel.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::sensor::HWY_NAMESPACE {

// Crossings of many pixels in one interval, solved together.
class Crossings {
 public:
  explicit Crossings(EventSlots& events) : events_(events) {}

  // solve() before the next interval.
  void begin(const IntervalTimes& t) { clock_ = Clock(t); }

  // Where `which`: rising c1 s + c2 s^2 + c3 s^3 = level for s in [0, 1], `rise` being the cubic's value at 1.
  HWY_INLINE void add(M which, V level, V rise, V c1, V c2, V c3, VU place) {
    if (HWY_UNLIKELY(waiting_ > kRoom)) solve();
    const V guess = hn::Div(level, rise);
    const Compress compress(which);
    compress.store(level, level_ + waiting_);
    compress.store(guess, s_ + waiting_);
    compress.store(c1, c1_ + waiting_);
    compress.store(c2, c2_ + waiting_);
    compress.store(c3, c3_ + waiting_);
    compress.store(place, place_ + waiting_);
    waiting_ += compress.count();
  }

  void solve() {
    const F f;
    constexpr std::size_t kTogether = 2;           // the steps of one wait for each other
    for (std::size_t k = 0; k < kTogether; ++k) {  // lanes to spare are done at once
      const std::size_t at = waiting_ + k * hn::Lanes(f);
      for (float* row : {level_, s_, c1_}) hn::StoreU(hn::Set(f, 1.0f), f, row + at);
      for (float* row : {c2_, c3_}) hn::StoreU(hn::Zero(f), f, row + at);
    }
    for (std::size_t i = 0; i < waiting_; i += kTogether * hn::Lanes(f)) {
      Halley vectors[kTogether];
      for (std::size_t k = 0; k < kTogether; ++k) {
        const std::size_t at = i + k * hn::Lanes(f);
        vectors[k] = Halley(hn::Load(f, s_ + at), hn::Load(f, level_ + at), hn::Load(f, c1_ + at),
                            hn::Load(f, c2_ + at), hn::Load(f, c3_ + at), hn::Zero(f), hn::Set(f, 1.0f));
      }
      for (int n = 0; n < 8; ++n) {
        for (Halley& v : vectors) v.step();
        if (n > 0 && hn::AllTrue(f, hn::And(vectors[0].done, vectors[1].done))) break;
      }
      for (std::size_t k = 0; k < kTogether; ++k) hn::Store(clock_.us(vectors[k].s), I32(), us_ + i + k * hn::Lanes(f));
    }
    clock_.add(us_, place_, waiting_, events_);
    waiting_ = 0;
  }

 private:
  EventSlots& events_;
  Clock clock_;
  std::size_t waiting_ = 0;
  HWY_ALIGN float level_[kRoom + 3 * kLanes], s_[kRoom + 3 * kLanes], c1_[kRoom + 3 * kLanes], c2_[kRoom + 3 * kLanes],
      c3_[kRoom + 3 * kLanes];
  HWY_ALIGN std::uint32_t place_[kRoom + 3 * kLanes];
  HWY_ALIGN std::int32_t us_[kRoom + 3 * kLanes];
};

// A block of pixels, frame by frame: what a pixel needs of the last frames stays in the first cache.
class ThresholdBlock {
 public:
  static constexpr std::uint32_t kPixels = 1024;

  explicit ThresholdBlock(const KernelArguments& a) : a_(a), planes_(a), crossings_(*a.events) {}

  void run(std::uint32_t first, std::uint32_t end) {
    const F f;
    const auto lanes = static_cast<std::uint32_t>(hn::Lanes(f));
    first_ = first;
    count_ = end - first;
    std::copy_n(a_.light0 + first, count_, row(-2));
    std::copy_n(a_.light1 + first, count_, row(-1));
    planes_.begin(first, count_);
    std::size_t interval = 0;
    const auto planes = static_cast<int>(a_.planes.size());
    int i = 0;
    for (; i < planes; ++i) {
      const std::int64_t frame = a_.first_frame + i;
      if (frame > 1) {
        const IntervalTimes& t = a_.intervals[interval];
        crossings_.begin(t);
        // Lists instead of branches: whether light changes, and whether that makes events, cannot be guessed.
        // Where four frames are alike, nothing moves until the next that differs.
        std::size_t moving = 0;
        const float* now = planes_.next([&](std::uint32_t p, int same) {
          hn::StoreU(hn::LoadU(f, row(i - 1) + p), f, row(i) + p);
          moving_[moving] = p;
          moving += same < 3;
        });
        std::size_t active = 0;
        for (std::size_t k = 0; k < moving; ++k) {
          const std::uint32_t p = moving_[k];
          const V l1 = hn::LoadU(f, row(i - 1) + p);
          hn::StoreU(ln_current(a_, hn::LoadU(f, now + p), l1), f, row(i) + p);
          active_[active] = p;
          active += !hn::AllFalse(f, crossing(p, l1));
        }
        for (std::size_t k = 0; k < active; ++k)
          step(t, interval, active_[k], i, [&](std::uint32_t p, V l1, V s0) {
            return inner_slope(s0, per(l1, hn::LoadU(f, row(i) + p), t.per_next), t);
          });
        crossings_.solve();
        ++interval;
      } else {
        const float* now = planes_.next([](std::uint32_t, int) {});
        for (std::uint32_t p = 0; p < count_; p += lanes) {
          const V dark = hn::Set(f, std::log(kFloor_fa));
          const V l = ln_current(a_, hn::LoadU(f, now + p), frame == 0 ? dark : hn::LoadU(f, row(i - 1) + p));
          hn::StoreU(l, f, row(i) + p);
        }
        if (frame == 0) std::copy_n(row(i), count_, a_.reference + first);
      }
    }

    if (interval > 0) {
      const IntervalTimes& t = a_.intervals[interval - 1];
      for (std::uint32_t p = 0; p < count_; p += lanes) {
        const V l0 = hn::LoadU(f, row(i - 2) + p);
        const V s0 = per(hn::LoadU(f, row(i - 3) + p), l0, t.per_h);
        const V s1 = per(l0, hn::LoadU(f, row(i - 1) + p), t.per_next);
        store_lanes(inner_slope(s0, s1, t), std::min(lanes, count_ - p), a_.m0 + first + p);
      }
    }
    if (a_.last && interval < a_.intervals.size()) {
      // No frame follows: the chord is the slope at the end.
      const IntervalTimes& t = a_.intervals[interval];
      crossings_.begin(t);
      for (std::uint32_t p = 0; p < count_; p += lanes)
        step(t, t.step == 0 ? kChord : 0, p, i, [](std::uint32_t, V, V s0) { return s0; });
      crossings_.solve();
    }
    std::copy_n(row(i - 2), count_, a_.light0 + first);
    std::copy_n(row(i - 1), count_, a_.light1 + first);
  }

 private:
  static constexpr std::size_t kWidth = kPixels + kMaxLanes, kChord = ~std::size_t{0};

  static HWY_INLINE V per(V from, V to, float per_us) { return hn::Mul(hn::Sub(to, from), hn::Set(F(), per_us)); }
  float* row(int i) { return l_[static_cast<unsigned>(i) & 3]; }  // ln I at plane i, as far as three back
  static HWY_INLINE V ln_current(const KernelArguments& a, V value, V before) {
    V current;
    const M lit = current_of(a, value, current);
    return hn::IfThenElse(lit, ln(current), before);
  }

  // Slope at the start of an interval. It is asked for where there are events.
  V slope_at_start(const IntervalTimes& t, std::size_t interval, std::uint32_t p, int i, V l0, V l1, V s0) {
    const F f;
    if (interval == kChord) return s0;
    if (t.step == 0) return end_slope(s0, per(l1, hn::LoadU(f, row(i) + p), t.per_next), t.h_us, 1 / t.per_next);
    if (interval == 0) return hn::LoadU(f, a_.m0 + first_ + p);
    const IntervalTimes& before = a_.intervals[interval - 1];
    return inner_slope(per(hn::LoadU(f, row(i - 3) + p), l0, before.per_h), s0, before);
  }

  HWY_INLINE M crossing(std::uint32_t p, V l1) const {
    const F f;
    const V moved = hn::Sub(l1, hn::LoadU(f, a_.reference + first_ + p));
    return hn::Or(hn::Ge(moved, hn::LoadU(f, a_.threshold_on + first_ + p)),
                  hn::Le(moved, hn::Neg(hn::LoadU(f, a_.threshold_off + first_ + p))));
  }

  // The interval between planes i - 2 and i - 1.
  template <class SlopeAtEnd>
  HWY_INLINE void step(const IntervalTimes& t, std::size_t interval, std::uint32_t p, int i,
                       const SlopeAtEnd& slope_at_end) {
    const F f;
    const U32 u;
    const std::uint32_t pixel = first_ + p;
    V reference = hn::LoadU(f, a_.reference + pixel);
    const V l1 = hn::LoadU(f, row(i - 1) + p);
    const V on = hn::LoadU(f, a_.threshold_on + pixel), off = hn::Neg(hn::LoadU(f, a_.threshold_off + pixel));
    const V moved = hn::Sub(l1, reference);
    const M rising = hn::Ge(moved, on), active = hn::And(crossing(p, l1), hn::FirstN(f, count_ - p));
    // The k-th event is where the monotone cubic has moved by k thresholds; from l0, and upwards for ON and OFF alike.
    const V l0 = hn::LoadU(f, row(i - 2) + p), s0 = per(l0, l1, t.per_h);
    const V threshold = hn::IfThenElse(rising, on, off);
    const V count = hn::IfThenElseZero(active, hn::Floor(hn::Div(moved, threshold)));
    const V h = hn::Set(f, t.h_us), up = hn::CopySign(hn::Set(f, 1.0f), threshold), up_h = hn::Mul(up, h);
    const V two = hn::Set(f, 2.0f), three = hn::Set(f, 3.0f);
    const V rise = hn::Mul(up, hn::Sub(l1, l0));
    const V c1 = hn::Mul(up_h, slope_at_start(t, interval, p, i, l0, l1, s0));
    const V end = hn::Mul(up_h, slope_at_end(p, l1, s0));
    const V c2 = hn::Sub(hn::Mul(three, rise), hn::MulAdd(two, c1, end));
    const V c3 = hn::NegMulAdd(two, rise, hn::Add(c1, end));
    const V start = hn::Mul(up, hn::Sub(reference, l0)), each = hn::Abs(threshold);
    const VU place = hn::Or(hn::ShiftLeft<kKeyPixelShift>(iota(pixel)),
                            hn::IfThenElseZero(hn::RebindMask(u, rising), hn::Set(u, 1u << kKeyOnShift)));
    V k = hn::Set(f, 1.0f);
    for (M which = hn::Ge(count, k); !hn::AllFalse(f, which); which = hn::Ge(count, k)) {
      crossings_.add(which, hn::MulAdd(k, each, start), rise, c1, c2, c3, place);
      k = hn::Add(k, hn::Set(f, 1.0f));
    }
    reference = hn::MulAdd(count, threshold, reference);
    store_lanes(reference, std::min(static_cast<std::uint32_t>(hn::Lanes(f)), count_ - p), a_.reference + pixel);
  }

  const KernelArguments& a_;
  Planes<kPixels> planes_;
  Crossings crossings_;
  std::uint32_t first_ = 0, count_ = 0;
  std::uint32_t moving_[kPixels + 1], active_[kPixels + 1];
  float l_[4][kWidth];
};

void RunThresholdKernel(const KernelArguments& a) {
  const auto block = std::make_unique<ThresholdBlock>(a);
  const std::uint32_t end = a.first + a.count;
  for (std::uint32_t first = a.first; first < end; first += ThresholdBlock::kPixels)
    block->run(first, std::min(end, first + ThresholdBlock::kPixels));
}

}  // namespace pecs::sensor::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace pecs::sensor {
HWY_EXPORT(RunThresholdKernel);
void run_threshold_kernel(const KernelArguments& arguments) { HWY_DYNAMIC_DISPATCH(RunThresholdKernel)(arguments); }
}  // namespace pecs::sensor
#endif
