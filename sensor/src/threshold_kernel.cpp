// Pixels of thresholds alone (chip `ideal`): V = ln I. Included once per instruction set by Highway's foreach_target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "threshold_kernel.cpp"
#include <hwy/foreach_target.h>
// then
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "pixel_kernel.h"
#include "pixel_math-inl.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::sensor::HWY_NAMESPACE {

constexpr std::size_t kLanes = hn::MaxLanes(F());

struct CompressTable {
  std::uint8_t counts[256] = {}, lanes[256][8] = {};
  constexpr CompressTable() {
    for (std::size_t bits = 0; bits < 256; ++bits)
      for (std::uint8_t lane = 0; lane < 8; ++lane)
        if (bits >> lane & 1) lanes[bits][counts[bits]++] = lane;
  }
};
constexpr CompressTable kTable;

// Moves chosen lanes to the front, for several vectors with one choice. Highway's own copies its tables at every call
// where there is no instruction for it.
class Compress {
 public:
  explicit Compress(M which) : which_(which) {
    if constexpr (kByTable) {
      std::uint8_t bits[8] = {};
      hn::StoreMaskBits(F(), which, bits);
      count_ = kTable.counts[bits[0]];
      const hn::Rebind<std::uint8_t, F> u8;
      indices_ = hn::IndicesFromVec(F(), hn::PromoteTo(U32(), hn::LoadU(u8, kTable.lanes[bits[0]])));
    } else {
      count_ = hn::CountTrue(F(), which);
    }
  }
  std::size_t count() const { return count_; }
  template <class Vector, class T>
  HWY_INLINE void store(Vector v, T* to) const {
    const hn::ScalableTag<T> d;
    if constexpr (kByTable)
      hn::StoreU(hn::BitCast(d, hn::TableLookupLanes(hn::BitCast(F(), v), indices_)), d, to);
    else
      hn::CompressStore(v, hn::RebindMask(d, which_), d, to);
  }

 private:
  static constexpr bool kByTable = kLanes <= 8;
  M which_;
  decltype(hn::IndicesFromVec(F(), hn::Zero(U32()))) indices_{};
  std::size_t count_ = 0;
};

// Crossings of many pixels and intervals, solved together.
class Crossings {
 public:
  explicit Crossings(const KernelArguments& a) : a_(a) {
    for (const IntervalTimes& t : a.intervals) {
      const double whole = std::floor(t.t0_us);
      base_.push_back(event_key(static_cast<std::int64_t>(whole), 0, false));
      rounding_.push_back(static_cast<float>(t.t0_us - whole) + 0.5f);
    }
  }

  // Where `which`: rising c1 s + c2 s^2 + c3 s^3 = level for s in [0, 1], `rise` being the cubic's value at 1.
  HWY_INLINE void add(M which, V level, V rise, V c1, V c2, V c3, VU place, std::size_t interval) {
    const U32 u;
    if (HWY_UNLIKELY(waiting_ > kRoom)) solve();
    const V guess = hn::Div(level, rise);
    const Compress compress(which);
    compress.store(level, level_ + waiting_);
    compress.store(guess, s_ + waiting_);
    compress.store(c1, c1_ + waiting_);
    compress.store(c2, c2_ + waiting_);
    compress.store(c3, c3_ + waiting_);
    compress.store(place, place_ + waiting_);
    hn::StoreU(hn::Set(u, static_cast<std::uint32_t>(interval)), u, in_ + waiting_);
    waiting_ += compress.count();
  }

  // Newton's steps, kept in the bracket; a lane stops by itself when a step was so short that the next would be
  // nothing.
  void solve() {
    const F f;
    const V zero = hn::Zero(f), one = hn::Set(f, 1.0f), half = hn::Set(f, 0.5f), near = hn::Set(f, 1e-3f);
    for (std::size_t i = 0; i < waiting_; i += hn::Lanes(f)) {
      const V c1 = hn::Load(f, c1_ + i), c2 = hn::Load(f, c2_ + i), c3 = hn::Load(f, c3_ + i);
      const V level = hn::Load(f, level_ + i);
      const V c2_2 = hn::Add(c2, c2), c3_3 = hn::Mul(hn::Set(f, 3.0f), c3);
      V a = zero, b = one;
      V s = hn::Min(hn::Max(hn::Load(f, s_ + i), zero), one);
      M done = hn::Lt(one, zero);
      for (int n = 0; n < 8 && !hn::AllTrue(f, done); ++n) {
        const V off = hn::Sub(hn::Mul(hn::MulAdd(hn::MulAdd(c3, s, c2), s, c1), s), level);
        const V slope = hn::MulAdd(hn::MulAdd(c3_3, s, c2_2), s, c1);
        const M below = hn::Lt(off, zero);
        a = hn::IfThenElse(below, s, a);
        b = hn::IfThenElse(below, b, s);
        const V newton = hn::Sub(s, hn::Div(off, slope));
        const M inside = hn::And(hn::Ge(newton, a), hn::Le(newton, b));
        const V next = hn::IfThenElse(done, s, hn::IfThenElse(inside, newton, hn::Mul(half, hn::Add(a, b))));
        done = hn::Or(done, hn::And(inside, hn::Lt(hn::Abs(hn::Sub(next, s)), near)));
        s = next;
      }
      hn::Store(s, f, s_ + i);
    }
    const std::size_t before = a_.events->size();
    a_.events->resize(before + waiting_);
    EventKey* to = a_.events->data() + before;
    for (std::size_t i = 0; i < waiting_; ++i) {
      const std::uint32_t k = in_[i];
      const auto us = static_cast<std::uint32_t>(s_[i] * a_.intervals[k].h_us + rounding_[k]);
      to[i] = base_[k] + (EventKey{us} << kKeyTimeShift) + place_[i];
    }
    waiting_ = 0;
  }

 private:
  static constexpr std::size_t kRoom = 512;
  const KernelArguments& a_;
  std::vector<EventKey> base_;   // of an interval: its first whole us
  std::vector<float> rounding_;  // the rest [us], and a half
  std::size_t waiting_ = 0;
  HWY_ALIGN float level_[kRoom + 2 * kLanes], s_[kRoom + 2 * kLanes], c1_[kRoom + 2 * kLanes], c2_[kRoom + 2 * kLanes],
      c3_[kRoom + 2 * kLanes];
  HWY_ALIGN std::uint32_t place_[kRoom + 2 * kLanes], in_[kRoom + 2 * kLanes];
};

// One vector of pixels through the planes; values: rows of Block. From plane `live` on they stay as they are.
HWY_INLINE void run_vector(const KernelArguments& a, std::uint32_t pixel, std::uint32_t lanes, const float* values,
                           std::size_t live, Crossings& crossings) {
  const F f;
  const U32 u;
  const V zero = hn::Zero(f), two = hn::Set(f, 2.0f), three = hn::Set(f, 3.0f);
  const V on = hn::LoadU(f, a.threshold_on + pixel), off = hn::Neg(hn::LoadU(f, a.threshold_off + pixel));
  const VU place = hn::ShiftLeft<kKeyPixelShift>(hn::Iota(u, pixel));
  const M mine = hn::FirstN(f, lanes);
  V l0 = hn::LoadU(f, a.l0 + pixel), l1 = hn::LoadU(f, a.l1 + pixel), m0 = hn::LoadU(f, a.m0 + pixel);
  V reference = hn::LoadU(f, a.reference + pixel);

  // Slopes are needed where there are events: m0 is that at l0, or follows from the slope before and s0.
  V slope_before = zero;
  const IntervalTimes* before = nullptr;  // null: m0 holds
  const auto step = [&](const IntervalTimes& t, std::size_t interval, V s0, auto&& slope_at_end) {
    const V moved = hn::Sub(l1, reference);
    const M rising = hn::Ge(moved, on);
    const M active = hn::And(mine, hn::Or(rising, hn::Le(moved, off)));
    if (HWY_LIKELY(hn::AllFalse(f, active))) return;
    // The k-th event is where the monotone cubic has moved by k thresholds; from l0, and upwards for ON and OFF alike.
    const V threshold = hn::IfThenElse(rising, on, off);
    const V count = hn::IfThenElseZero(active, hn::Floor(hn::Div(moved, threshold)));
    const V h = hn::Set(f, t.h_us), up = hn::CopySign(hn::Set(f, 1.0f), threshold), up_h = hn::Mul(up, h);
    const V rise = hn::Mul(up, hn::Sub(l1, l0));
    const V c1 = hn::Mul(up_h, before ? inner_slope(slope_before, s0, *before) : m0);
    const V end = hn::Mul(up_h, slope_at_end());
    const V c2 = hn::Sub(hn::Mul(three, rise), hn::MulAdd(two, c1, end));
    const V c3 = hn::NegMulAdd(two, rise, hn::Add(c1, end));
    const V start = hn::Mul(up, hn::Sub(reference, l0)), each = hn::Abs(threshold);
    const VU where = hn::Or(place, hn::IfThenElseZero(hn::RebindMask(u, rising), hn::Set(u, 1u << kKeyOnShift)));
    V k = hn::Set(f, 1.0f);
    for (M which = hn::Ge(count, k); !hn::AllFalse(f, which); which = hn::Ge(count, k)) {
      crossings.add(which, hn::MulAdd(k, each, start), rise, c1, c2, c3, where, interval);
      k = hn::Add(k, hn::Set(f, 1.0f));
    }
    reference = hn::MulAdd(count, threshold, reference);
  };

  V last = hn::Set(f, -1.0f);  // no light has it
  int same = 0;
  std::size_t interval = 0;
  for (std::size_t i = 0; i < live; ++i) {
    const std::int64_t frame = a.first_frame + static_cast<std::int64_t>(i);
    const V value = hn::LoadU(f, values + i * Block::kStride);
    // Four frames alike, and nothing moves until the next that differs.
    same = hn::AllTrue(f, hn::Eq(value, last)) ? same + 1 : 0;
    if (same > 2 && frame > 2) {
      ++interval;
      continue;
    }
    last = value;
    const V l2 = ln_current(a, value, frame == 0 ? hn::Set(f, std::log(kFloor_fa)) : l1);
    if (frame == 0) {
      l1 = reference = l2;
      m0 = zero;
    } else if (frame > 1) {
      const IntervalTimes& t = a.intervals[interval];
      const V s0 = hn::Mul(hn::Sub(l1, l0), hn::Set(f, t.per_h));
      const V s1 = hn::Mul(hn::Sub(l2, l1), hn::Set(f, t.per_next));
      if (frame == 2) m0 = end_slope(s0, s1, t.h_us, 1 / t.per_next);
      step(t, interval, s0, [&] { return inner_slope(s0, s1, t); });
      slope_before = s0;
      before = &t;
      ++interval;
    }
    l0 = l1;
    l1 = l2;
  }
  if (live < a.planes.size()) {  // still to the end
    m0 = zero;
  } else {
    if (before) m0 = inner_slope(slope_before, hn::Mul(hn::Sub(l1, l0), hn::Set(f, before->per_next)), *before);
    before = nullptr;
    if (a.last && interval < a.intervals.size()) {
      // No frame follows: the chord is the slope at the end.
      const IntervalTimes& t = a.intervals[interval];
      const V s0 = hn::Mul(hn::Sub(l1, l0), hn::Set(f, t.per_h));
      if (t.step == 0) m0 = s0;
      step(t, interval, s0, [&] { return s0; });
    }
  }
  store_lanes(l0, lanes, a.l0 + pixel);
  store_lanes(l1, lanes, a.l1 + pixel);
  store_lanes(m0, lanes, a.m0 + pixel);
  store_lanes(reference, lanes, a.reference + pixel);
}

// Planes after which the pixels [first, end) have stood still for so long that nothing can happen to them.
std::size_t live_planes(const KernelArguments& a, std::uint32_t first, std::uint32_t end) {
  const auto same = [&](std::size_t i) {
    return std::memcmp(a.planes[i] + first, a.planes[i - 1] + first, (end - first) * sizeof(float)) == 0;
  };
  std::size_t last_change = a.planes.empty() ? 0 : a.planes.size() - 1;
  while (last_change > 0 && same(last_change)) --last_change;
  return std::min(a.planes.size(), last_change + 4);
}

void RunThresholdKernel(const KernelArguments& a) {
  const auto lanes = static_cast<std::uint32_t>(hn::Lanes(F()));
  const auto end = a.first + a.count;
  Block values(a);
  Crossings crossings(a);
  for (std::uint32_t block = a.first; block < end; block += Block::kPixels) {
    const std::uint32_t block_end = std::min(end, block + Block::kPixels);
    const std::size_t live = live_planes(a, block, block_end);
    values.gather(block, block_end, live);
    for (std::uint32_t pixel = block; pixel < block_end; pixel += lanes)
      run_vector(a, pixel, std::min(lanes, block_end - pixel), values.from(pixel - block), live, crossings);
  }
  crossings.solve();
}

}  // namespace pecs::sensor::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace pecs::sensor {
HWY_EXPORT(RunThresholdKernel);
void run_threshold_kernel(const KernelArguments& arguments) { HWY_DYNAMIC_DISPATCH(RunThresholdKernel)(arguments); }
}  // namespace pecs::sensor
#endif
