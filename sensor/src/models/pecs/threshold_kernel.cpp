// Pixels with thresholds only (chip `ideal`): V = ln I. Included once per instruction set by Highway's foreach_target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "models/pecs/threshold_kernel.cpp"
#include <hwy/foreach_target.h>
// then
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <span>

#include "models/pecs/math-inl.h"
// then
#include "models/pecs/cubic.h"
#include "models/pecs/kernel.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::sensor::HWY_NAMESPACE {

// Crossings of many pixels in one interval, solved together. Crossings are ordered by pixel, which speeds up the
// sorter.
class Crossings {
 public:
  // A vector of pixels with `count` crossings each on a monotone piece of the interval: number k = 1, 2, … is where
  // c1 u + c2 u^2 + c3 u^3 rises to start + k each, u in [0, 1]. rise: the cubic's value at 1. The piece begins at
  // `from` and has the length `span`, as shares of the interval.
  struct Pixels {
    V count, start, each, rise, c1, c2, c3, from, span;
    VU place;
  };

  explicit Crossings(EventSlots& events) : events_(events) {}

  // Call solve() before the next interval.
  void begin(const IntervalTimes& t) { clock_ = Clock(t); }

  // At most one vector of pixels, each with a crossing.
  HWY_INLINE void add(const Pixels& v, std::size_t pixels) {
    const F f;
    if (HWY_UNLIKELY(pixels_ + pixels > kMostPixels)) solve();
    const V values[kRows] = {v.start, v.each, v.rise, v.c1, v.c2, v.c3, v.from, v.span};
    for (std::size_t row = 0; row < kRows; ++row) hn::StoreU(values[row], f, rows_[row] + pixels_);
    hn::StoreU(v.place, U32(), place_of_ + pixels_);
    hn::StoreU(hn::ConvertTo(I32(), v.count), I32(), count_ + pixels_);
    pixels_ += pixels;
  }

  void solve() {
    const hn::FixedTag<std::uint32_t, 4> four;
    for (std::size_t j = 0; j < pixels_; ++j) {
      // Always writes four: few pixels have more crossings.
      const auto count = static_cast<std::uint32_t>(count_[j]);
      const std::uint32_t none = static_cast<std::uint32_t>(j) << kNumberBits;
      hn::StoreU(hn::Add(hn::Iota(four, 1), hn::Set(four, none)), four, list_ + listed_);
      listed_ += std::min(count, 4u);
      for (std::uint32_t k = 5; k <= count; ++k) {
        if (HWY_UNLIKELY(listed_ > kRoom)) solve_listed();
        list_[listed_++] = none + k;
      }
      if (HWY_UNLIKELY(listed_ > kRoom)) solve_listed();
    }
    solve_listed();
    pixels_ = 0;
  }

 private:
  enum Row : std::size_t { kStart, kEach, kRise, kC1, kC2, kC3, kFrom, kSpan, kRows };
  static constexpr std::size_t kMostPixels = 512;
  static constexpr int kNumberBits = 22;       // bits of a crossing's number within its pixel
  static constexpr std::size_t kTogether = 4;  // vectors: hides the latency of a step
  static constexpr std::size_t kPlaces = kRoom + 4 + kTogether * kLanes;

  void solve_listed() {
    if (listed_ == 0) return;
    const F f;
    const U32 u;
    const std::size_t lanes = hn::Lanes(f);
    std::fill_n(list_ + listed_, kTogether * lanes, list_[listed_ - 1]);  // pads the last vectors
    for (std::size_t i = 0; i < listed_; i += kTogether * lanes) {
      Halley<V> vectors[kTogether];
      V from[kTogether], span[kTogether];
      for (std::size_t k = 0; k < kTogether; ++k) {
        // The crossings of a vector belong to at most as many pixels as lanes, stored in order.
        const std::size_t at = i + k * lanes;
        const std::uint32_t first = list_[at] >> kNumberBits;
        const VU listed = hn::LoadU(u, list_ + at);
        const auto pixels = hn::IndicesFromVec(f, hn::Sub(hn::ShiftRight<kNumberBits>(listed), hn::Set(u, first)));
        const auto number = hn::And(listed, hn::Set(u, (1u << kNumberBits) - 1));
        const auto of = [&](Row row) { return hn::TableLookupLanes(hn::LoadU(f, rows_[row] + first), pixels); };
        const V level = hn::MulAdd(hn::ConvertTo(f, hn::BitCast(I32(), number)), of(kEach), of(kStart));
        vectors[k] =
            Halley<V>(hn::Div(level, of(kRise)), level, of(kC1), of(kC2), of(kC3), hn::Zero(f), hn::Set(f, 1.0f));
        from[k] = of(kFrom);
        span[k] = of(kSpan);
        const V place = hn::TableLookupLanes(hn::BitCast(f, hn::LoadU(u, place_of_ + first)), pixels);
        hn::StoreU(hn::BitCast(u, place), u, place_ + at);
      }
      for (int n = 0; n < 8; ++n) {
        for (Halley<V>& v : vectors) v.step();
        if (n > 0 && std::ranges::all_of(vectors, [&](const Halley<V>& v) { return hn::AllTrue(f, v.done); })) break;
      }
      for (std::size_t k = 0; k < kTogether; ++k) {
        const V s = hn::MulAdd(vectors[k].s, span[k], from[k]);
        hn::StoreU(clock_.us(s), I32(), us_ + i + k * lanes);
      }
    }
    clock_.add(us_, place_, listed_, events_);
    listed_ = 0;
  }

  EventSlots& events_;
  Clock clock_;
  std::size_t pixels_ = 0, listed_ = 0;
  HWY_ALIGN float rows_[kRows][kMostPixels + kLanes];
  std::uint32_t place_of_[kMostPixels + kLanes];
  std::int32_t count_[kMostPixels + kLanes];
  std::uint32_t list_[kPlaces], place_[kPlaces];
  std::int32_t us_[kPlaces];
};

// A block of pixels, frame by frame: the last frames' values of a block fit the L1 cache.
class ThresholdBlock {
 public:
  static constexpr std::uint32_t kPixels = 4096;

  explicit ThresholdBlock(const KernelArguments& a) : a_(a), planes_(a), crossings_(*a.events) {}

  void run(std::uint32_t first, std::uint32_t end) {
    first_ = first;
    count_ = end - first;
    load();
    planes_.begin(first, count_);
    planes_.changed() = moved_;
    std::size_t interval = 0;
    int i = 0;
    for (; i < static_cast<int>(a_.planes.size()); ++i) {
      take_light(i);
      if (a_.first_frame + i < 2) continue;
      const IntervalTimes& t = a_.intervals[interval++];
      find_slopes(t, i);
      find_events(t, i, 1);
    }
    if (a_.last && interval < a_.intervals.size()) {
      // No frame follows: the chord is the slope at the end.
      const IntervalTimes& t = a_.intervals[interval];
      for (std::size_t w = 0; w < planes_.words(); ++w)
        each_vector(planes_.changed(w), w, [&](std::uint32_t p) {
          const V s0 = chord(i - 2, p, t.per_h);
          if (t.step == 0) hn::StoreU(s0, F(), slope(i - 2) + p);
          hn::StoreU(s0, F(), slope(i - 1) + p);
        });
      find_events(t, i, 0);
    }
    store(i);
  }

 private:
  static constexpr std::size_t kWidth = kPixels + kMaxLanes;

  void load() {
    for (const int i : {-4, -3, -2}) std::copy_n(a_.light0 + first_, count_, row(i));
    std::copy_n(a_.light1 + first_, count_, row(-1));
    std::copy_n(a_.m0 + first_, count_, slope(-2));
    std::fill_n(slope(-1), kWidth, 0.0f);
    moved_.set(count_, [&](std::uint32_t p) { return differs(row(-2), row(-1), p); });
    any_moved_ = moved_.any();
  }
  void store(int i) {
    if (!any_moved_) return;
    std::copy_n(row(i - 2), count_, a_.light0 + first_);
    std::copy_n(row(i - 1), count_, a_.light1 + first_);
    std::copy_n(slope(i - 2), count_, a_.m0 + first_);
  }
  static HWY_INLINE bool differs(const float* a, const float* b, std::uint32_t p) {
    return !hn::AllTrue(F(), hn::Eq(hn::LoadU(F(), a + p), hn::LoadU(F(), b + p)));
  }

  // ln I of plane i. Four rows rotate, so a vector is copied from the last one until all four are equal.
  void take_light(int i) {
    const F f;
    const std::int64_t frame = a_.first_frame + i;
    const float* now = planes_.next();
    const V dark = hn::Set(f, std::log(kDarkest_fa));
    const auto take = [&](std::uint32_t p) {
      const V before = frame == 0 ? dark : hn::LoadU(f, row(i - 1) + p);
      hn::StoreU(ln_current(a_, hn::LoadU(f, now + p), before), f, row(i) + p);
    };
    for (std::size_t w = 0; w < planes_.words(); ++w) {
      const std::uint64_t changed = planes_.changed(w);
      const std::uint64_t before = planes_.changed(w, 1) | planes_.changed(w, 2) | planes_.changed(w, 3);
      each_vector(changed, w, take);
      each_vector(before & ~changed, w,
                  [&](std::uint32_t p) { hn::StoreU(hn::LoadU(f, row(i - 1) + p), f, row(i) + p); });
      any_moved_ |= changed != 0;
    }
    if (i == 0) {  // the previous plane is gone; its ln I remains
      planes_.changed().set(count_, [&](std::uint32_t p) { return frame == 0 || differs(row(-1), row(0), p); });
      any_moved_ = moved_.any() || planes_.changed().any();
    }
    if (frame == 0) std::copy_n(row(i), count_, a_.reference + first_);
  }

  // Slopes at plane i - 1. They are 0 but where the light changes before and after it.
  void find_slopes(const IntervalTimes& t, int i) {
    const F f;
    for (std::size_t w = 0; w < planes_.words(); ++w) {
      const std::uint64_t before = planes_.changed(w, 1), both = planes_.changed(w) & before;
      // The row holds the slopes at plane i - 3.
      each_vector(planes_.changed(w, 2) & ~both, w,
                  [&](std::uint32_t p) { hn::StoreU(hn::Zero(f), f, slope(i - 1) + p); });
      if (t.step == 0)
        each_vector(before, w, [&](std::uint32_t p) {
          const V s1 = chord(i - 1, p, t.per_next);
          hn::StoreU(end_slope(chord(i - 2, p, t.per_h), s1, t.h_us, 1 / t.per_next), f, slope(i - 2) + p);
        });
      each_vector(both, w, [&](std::uint32_t p) {
        const V s0 = chord(i - 2, p, t.per_h), s1 = chord(i - 1, p, t.per_next);
        hn::StoreU(inner_slope(s0, s1, hn::LoadU(f, slope(i - 2) + p), t.slope), f, slope(i - 1) + p);
      });
    }
  }

  // Events of the interval between planes i - 2 and i - 1. Its light changes where the bits of the plane `planes_ago`
  // before the newest are set.
  HWY_INLINE void find_events(const IntervalTimes& t, int i, std::size_t planes_ago) {
    // Lists instead of branches, which would be mispredicted: changed light may or may not make events. Lists of
    // pixels, not vectors: an edge changes few lanes of a vector.
    crossings_.begin(t);
    const F f;
    const std::size_t lanes = hn::Lanes(f);
    const V h = hn::Set(f, t.h_us);
    const std::size_t turning = list(turning_, planes_ago, [&](std::uint32_t p) {
      const V rise = hn::Sub(hn::LoadU(f, row(i - 1) + p), hn::LoadU(f, row(i - 2) + p));
      return may_turn(hn::Mul(h, hn::LoadU(f, slope(i - 2) + p)), hn::Mul(h, hn::LoadU(f, slope(i - 1) + p)), rise);
    });
    for (const Piece piece : {Piece::first, Piece::second}) {
      std::size_t active = 0;
      for (std::size_t k = 0; k < turning; k += lanes) {
        const Part part = part_of(t, i, hn::LoadU(U32(), turning_ + k), piece);
        const M within = hn::And(hn::FirstN(f, turning - k), hn::Gt(part.span, hn::Zero(f)));
        const Compress compress(hn::And(within, crossing(part)));
        compress.store(hn::LoadU(U32(), turning_ + k), active_ + active);
        active += compress.count();
      }
      step_listed(t, active, i, piece);
    }
    const auto crosses = [&](std::uint32_t p) { return crossing(p, hn::LoadU(F(), row(i - 1) + p)); };
    step_listed(t, list(active_, planes_ago, crosses), i, Piece::last);
    crossings_.solve();
  }

  // Lists the pixels of changed light for whose vector `which` is set. Returns their number.
  template <class Which>
  HWY_INLINE std::size_t list(std::uint32_t* pixels, std::size_t planes_ago, const Which& which) {
    std::size_t count = 0;
    for (std::size_t w = 0; w < planes_.words(); ++w)
      each_vector(planes_.changed(w, planes_ago), w, [&](std::uint32_t p) {
        const Compress compress(which(p));
        compress.store(iota(p), pixels + count);
        count += compress.count();
      });
    while (count > 0 && pixels[count - 1] >= count_) --count;  // lanes beyond the block
    std::fill_n(pixels + count, hn::Lanes(F()), count > 0 ? pixels[0] : 0);
    return count;
  }

  // False where the cubic is monotone by Fritsch & Carlson (SIAM J. Numer. Anal. 17, 1980). m0, m1: slopes at its ends.
  static HWY_INLINE M may_turn(V m0, V m1, V rise) {
    const F f;
    return hn::Or(hn::Lt(hn::Min(hn::Mul(m0, rise), hn::Mul(m1, rise)), hn::Zero(f)),
                  hn::Gt(hn::Add(hn::Abs(m0), hn::Abs(m1)), hn::Mul(hn::Set(f, 3.0f), hn::Abs(rise))));
  }

  // Slope of the chord from plane i to the next one.
  HWY_INLINE V chord(int i, std::uint32_t p, float per_us) {
    return hn::Mul(hn::Sub(hn::LoadU(F(), row(i + 1) + p), hn::LoadU(F(), row(i) + p)), hn::Set(F(), per_us));
  }
  float* row(int i) { return l_[static_cast<unsigned>(i) & 3]; }    // ln I at plane i, as far as three back
  float* slope(int i) { return m_[static_cast<unsigned>(i) & 1]; }  // at plane i, as far as one back
  static HWY_INLINE V ln_current(const KernelArguments& a, V value, V before) {
    V current;
    const M lit = current_of(a, value, current);
    return hn::IfThenElse(lit, ln(current), before);
  }

  HWY_INLINE V threshold(const float* of_pixels, std::uint32_t p) const {
    return hn::LoadU(F(), a_.equal_thresholds ? of_pixels : of_pixels + first_ + p);
  }
  HWY_INLINE M crossing(std::uint32_t p, V l1) const {
    const F f;
    const V moved = hn::Sub(l1, hn::LoadU(f, a_.reference + first_ + p));
    return hn::Or(hn::Ge(moved, threshold(a_.threshold_on, p)), hn::Le(moved, hn::Neg(threshold(a_.threshold_off, p))));
  }

  static HWY_INLINE V at(const float* row, hn::Vec<I32> pixels) { return hn::GatherIndex(F(), row, pixels); }

  // Monotone pieces of an interval. The first two are empty where the light does not turn.
  enum class Piece { first, second, last };
  // A piece for a vector of pixels: where it begins, its length, ln I at its ends, and the cubic along it, from 0 on.
  struct Part {
    V from, span, l0, l1, reference, on, off, c1, c2, c3;
  };
  HWY_INLINE M crossing(const Part& part) const {
    const V moved = hn::Sub(part.l1, part.reference);
    return hn::Or(hn::Ge(moved, part.on), hn::Le(moved, part.off));
  }

  HWY_INLINE Part part_of(const IntervalTimes& t, int i, VU numbers, Piece piece) {
    const F f;
    const auto pixels = hn::BitCast(I32(), numbers);
    const auto threshold_of = [&](const float* row) {
      return a_.equal_thresholds ? hn::LoadU(f, row) : at(row + first_, pixels);
    };
    const V h = hn::Set(f, t.h_us), zero = hn::Zero(f);
    const V l0 = at(row(i - 2), pixels), l1 = at(row(i - 1), pixels);
    const V m0 = hn::Mul(h, at(slope(i - 2), pixels)), m1 = hn::Mul(h, at(slope(i - 1), pixels));
    const V rise = hn::Sub(l1, l0);
    const auto q = hermite(zero, rise, m0, m1);
    const M turn = may_turn(m0, m1, rise);
    V first = zero, second = zero;
    if (HWY_UNLIKELY(!hn::AllFalse(f, turn))) {
      const auto ends = turns(q, zero);
      first = hn::IfThenElseZero(turn, ends.first);
      second = hn::IfThenElseZero(turn, ends.second);
    }
    const V from = piece == Piece::first ? zero : piece == Piece::second ? first : second;
    const V end = piece == Piece::first ? first : piece == Piece::second ? second : hn::Set(f, 1.0f);
    const V span = hn::Sub(end, from), span2 = hn::Mul(span, span);
    return {from,
            span,
            hn::Add(l0, q.at(from)),
            piece == Piece::last ? l1 : hn::Add(l0, q.at(end)),
            at(a_.reference + first_, pixels),
            threshold_of(a_.threshold_on),
            hn::Neg(threshold_of(a_.threshold_off)),
            hn::Mul(span, q.slope(from)),
            hn::Mul(span2, hn::MulAdd(hn::Mul(hn::Set(f, 3.0f), q.c3), from, q.c2)),
            hn::Mul(span2, hn::Mul(span, q.c3))};
  }

  HWY_INLINE void step_listed(const IntervalTimes& t, std::size_t active, int i, Piece piece) {
    const std::size_t lanes = hn::Lanes(F());
    std::fill_n(active_ + active, lanes, active > 0 ? active_[0] : 0);
    for (std::size_t k = 0; k < active; k += lanes)
      step(t, std::span(active_ + k, std::min(lanes, active - k)), i, piece);
  }

  // A piece of the interval for at most one vector of pixels; `active` is padded to a vector.
  HWY_INLINE void step(const IntervalTimes& t, std::span<const std::uint32_t> active, int i, Piece piece) {
    const F f;
    const U32 u;
    const VU numbers = hn::LoadU(u, active.data());
    const Part part = part_of(t, i, numbers, piece);
    const V moved = hn::Sub(part.l1, part.reference);
    const M rising = hn::Ge(moved, part.on);
    // The k-th event is where the cubic has moved by k thresholds. Measured from l0, with OFF mirrored to
    // rise.
    const V threshold = hn::IfThenElse(rising, part.on, part.off);
    const V count = hn::IfThenElseZero(hn::FirstN(f, active.size()), hn::Floor(hn::Div(moved, threshold)));
    const V up = hn::CopySign(hn::Set(f, 1.0f), threshold);
    const VU place = hn::Or(hn::ShiftLeft<kKeyPixelShift>(hn::Add(numbers, hn::Set(u, first_))),
                            hn::IfThenElseZero(hn::RebindMask(u, rising), hn::Set(u, 1u << kKeyOnShift)));
    crossings_.add({count, hn::Mul(up, hn::Sub(part.reference, part.l0)), hn::Abs(threshold),
                    hn::Mul(up, hn::Sub(part.l1, part.l0)), hn::Mul(up, part.c1), hn::Mul(up, part.c2),
                    hn::Mul(up, part.c3), part.from, part.span, place},
                   active.size());
    HWY_ALIGN float after[kLanes];
    hn::Store(hn::MulAdd(count, threshold, part.reference), f, after);
    for (std::size_t lane = 0; lane < active.size(); ++lane) a_.reference[first_ + active[lane]] = after[lane];
  }

  const KernelArguments& a_;
  Planes<kPixels> planes_;
  Crossings crossings_;
  std::uint32_t first_ = 0, count_ = 0;
  VectorBits<kPixels> moved_;  // at the start of a batch: where the last frame differs from the previous one
  bool any_moved_ = false;     // since then
  std::uint32_t active_[kPixels + 2 * kLanes], turning_[kPixels + 2 * kLanes];
  float l_[4][kWidth] = {}, m_[2][kWidth] = {};
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
