// Vectors, planes of pixels and event output for the pixel kernels. Included once per instruction set, after
// hwy/highway.h.
#if defined(PECS_PIXEL_MATH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef PECS_PIXEL_MATH_INL_H_
#undef PECS_PIXEL_MATH_INL_H_
#else
#define PECS_PIXEL_MATH_INL_H_
#endif

#include <hwy/cache_control.h>
#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <concepts>

#include "light/float_math.h"
#include "models/pecs/kernel.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::sensor::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using F = hn::ScalableTag<float>;
using I32 = hn::RebindToSigned<F>;
using U32 = hn::RebindToUnsigned<F>;
using V = hn::Vec<F>;
using VU = hn::Vec<U32>;
using M = hn::Mask<F>;

// first, first + 1, … (hn::Iota of a variable is slow: it writes lane by lane).
HWY_INLINE VU iota(std::uint32_t first) { return hn::Add(hn::Iota(U32(), 0), hn::Set(U32(), first)); }

// ln x for positive, finite, normal x: x = 2^e m with m in [sqrt(1/2), sqrt(2)), then the minimax polynomial of
// Cephes' logf; relative error 1e-7.
HWY_INLINE V ln(V x) {
  const F f;
  const I32 i;
  const auto bits = hn::BitCast(i, x);
  const auto e = hn::ShiftRight<23>(hn::Sub(bits, hn::Set(i, 0x3f3504f3)));
  const V m = hn::Sub(hn::BitCast(f, hn::Sub(bits, hn::ShiftLeft<23>(e))), hn::Set(f, 1.0f));
  const V exponent = hn::ConvertTo(f, e);
  const V z = hn::Mul(m, m);
  V p = hn::Set(f, 7.0376836292e-2f);
  for (const float c : {-1.1514610310e-1f, 1.1676998740e-1f, -1.2420140846e-1f, 1.4249322787e-1f, -1.6668057665e-1f,
                        2.0000714765e-1f, -2.4999993993e-1f, 3.3333331174e-1f})
    p = hn::MulAdd(p, m, hn::Set(f, c));
  V y = hn::Mul(hn::Mul(p, m), z);
  y = hn::MulAdd(exponent, hn::Set(f, -2.12194440e-4f), y);
  y = hn::NegMulAdd(hn::Set(f, 0.5f), z, y);
  return hn::MulAdd(exponent, hn::Set(f, 0.693359375f), hn::Add(m, y));
}

// The vector as a number type (number.h).
template <class T>
  requires std::same_as<T, V>
HWY_INLINE V number(double value) {
  return hn::Set(F(), static_cast<float>(value));
}
HWY_INLINE V operator-(V a) { return hn::Neg(a); }
HWY_INLINE V operator+(float a, V b) { return hn::Add(hn::Set(F(), a), b); }
HWY_INLINE V operator-(float a, V b) { return hn::Sub(hn::Set(F(), a), b); }
HWY_INLINE V operator*(float a, V b) { return hn::Mul(hn::Set(F(), a), b); }
HWY_INLINE V operator/(float a, V b) { return hn::Div(hn::Set(F(), a), b); }
HWY_INLINE M operator<(V a, float b) { return hn::Lt(a, hn::Set(F(), b)); }
HWY_INLINE M operator>(V a, float b) { return hn::Gt(a, hn::Set(F(), b)); }
HWY_INLINE M operator<=(V a, float b) { return hn::Le(a, hn::Set(F(), b)); }
HWY_INLINE M operator&&(M a, M b) { return hn::And(a, b); }
HWY_INLINE M operator||(M a, M b) { return hn::Or(a, b); }
HWY_INLINE M operator!(M a) { return hn::Not(a); }
HWY_INLINE bool all(M mask) { return hn::AllTrue(F(), mask); }
HWY_INLINE bool any(M mask) { return !hn::AllFalse(F(), mask); }
HWY_INLINE V select(M which, V yes, V no) { return hn::IfThenElse(which, yes, no); }
HWY_INLINE V select_or_zero(M which, V yes) { return hn::IfThenElseZero(which, yes); }
HWY_INLINE V mul_add(V a, V b, V c) { return hn::MulAdd(a, b, c); }
HWY_INLINE V mul_sub(V a, V b, V c) { return hn::MulSub(a, b, c); }
HWY_INLINE V neg_mul_add(V a, V b, V c) { return hn::NegMulAdd(a, b, c); }
HWY_INLINE V min(V a, V b) { return hn::Min(a, b); }
HWY_INLINE V max(V a, V b) { return hn::Max(a, b); }
HWY_INLINE V abs(V a) { return hn::Abs(a); }
HWY_INLINE V sqrt(V a) { return hn::Sqrt(a); }
HWY_INLINE V ceil(V a) { return hn::Ceil(a); }
HWY_INLINE V exp(V a) { return hn::Exp(F(), a); }
HWY_INLINE V log(V a) { return ln(a); }
HWY_INLINE V copy_sign(V size, V sign) { return hn::CopySign(size, sign); }

// Photo- plus dark current [fA] of a plane's values; false where that is not finite.
HWY_INLINE M current_of(const KernelArguments& a, V value, V& current) {
  const F f;
  const V sum = hn::MulAdd(value, hn::Set(f, a.gain_fa), hn::Set(f, a.dark_fa));
  current = hn::Max(sum, hn::Set(f, kDarkest_fa));
  return hn::Lt(sum, hn::Set(f, 1e30f));  // false for NaN
}

constexpr std::size_t kLanes = hn::MaxLanes(F());

// One bit for each vector of a block.
template <std::uint32_t kPixels>
struct VectorBits {
  static constexpr std::size_t kWords = kPixels / 4 / 64;  // vectors have four lanes at least
  std::uint64_t words[kWords] = {};

  static std::size_t words_of(std::uint32_t pixels) {
    return (pixels + 64 * hn::Lanes(F()) - 1) / (64 * hn::Lanes(F()));
  }
  // Sets the bits of a block's vectors for which is_set(p) is true.
  template <class IsSet>
  HWY_INLINE void set(std::uint32_t pixels, const IsSet& is_set) {
    const auto lanes = static_cast<std::uint32_t>(hn::Lanes(F()));
    std::uint32_t p = 0;
    for (std::size_t w = 0; w < words_of(pixels); ++w) {
      std::uint64_t word = 0;
      for (int bit = 0; bit < 64 && p < pixels; ++bit, p += lanes) word |= std::uint64_t{is_set(p)} << bit;
      words[w] = word;
    }
  }
  bool any() const {
    return std::ranges::any_of(words, [](std::uint64_t w) { return w != 0; });
  }
};

// visit(p) for the vectors of a word of bits.
template <class Visit>
HWY_INLINE void each_vector(std::uint64_t word, std::size_t index, const Visit& visit) {
  for (; word != 0; word &= word - 1)
    visit(static_cast<std::uint32_t>((64 * index + static_cast<std::size_t>(std::countr_zero(word))) * hn::Lanes(F())));
}

// A block of pixels, plane by plane.
template <std::uint32_t kPixels>
class Planes {
 public:
  using Bits = VectorBits<kPixels>;

  explicit Planes(const KernelArguments& a) : a_(a) {}
  void begin(std::uint32_t first, std::uint32_t count) {
    first_ = first;
    count_ = count;
    index_ = 0;
    before_ = nullptr;
    std::ranges::fill(changed_, Bits{});
  }
  std::size_t words() const { return Bits::words_of(count_); }
  // The next plane, padded to whole vectors with light 1.
  HWY_INLINE const float* next() {
    const F f;
    const float* now = a_.planes[index_] + first_;
    const float* ahead = index_ + 1 < a_.planes.size() ? a_.planes[index_ + 1] + first_ : now;
    if (const auto lanes = static_cast<std::uint32_t>(hn::Lanes(f)); count_ % lanes != 0) {
      float* copy = ragged_[index_ & 1];
      std::fill_n(std::copy_n(now, count_, copy), lanes - count_ % lanes, 1.0f);
      now = copy;
    }
    for (std::size_t k = kPlanes - 1; k > 0; --k) changed_[k] = changed_[k - 1];
    const float* before = before_;
    if (before)
      changed_[0].set(count_, [&](std::uint32_t p) {
        hwy::Prefetch(ahead + p);
        return !hn::AllTrue(f, hn::Eq(hn::LoadU(f, now + p), hn::LoadU(f, before + p)));
      });
    else
      changed_[0].set(count_, [](std::uint32_t) { return true; });
    before_ = now;
    ++index_;
    return now;
  }
  // Vectors in which the last plane, or one to three before it, differs from its predecessor; all, for the first.
  std::uint64_t changed(std::size_t word, std::size_t planes_ago = 0) const { return changed_[planes_ago].words[word]; }
  Bits& changed() { return changed_[0]; }
  // True if the vector at p changed in one of the last three planes.
  bool moves(std::uint32_t p) const {
    const std::size_t vector = p / hn::Lanes(F()), word = vector / 64;
    return (changed(word) | changed(word, 1) | changed(word, 2)) >> vector % 64 & 1;
  }

 private:
  static constexpr std::size_t kPlanes = 4;
  const KernelArguments& a_;
  std::uint32_t first_ = 0, count_ = 0;
  std::size_t index_ = 0;
  const float* before_ = nullptr;
  Bits changed_[kPlanes];
  float ragged_[2][kPixels];
};

struct CompressTable {
  std::uint8_t counts[256] = {}, lanes[256][8] = {};
  constexpr CompressTable() {
    for (std::size_t bits = 0; bits < 256; ++bits)
      for (std::uint8_t lane = 0; lane < 8; ++lane)
        if (bits >> lane & 1) lanes[bits][counts[bits]++] = lane;
  }
};
constexpr CompressTable kTable;

// Moves chosen lanes to the front, for several vectors with one choice. Without an instruction for it, hn::Compress
// copies its tables at every call.
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

constexpr std::size_t kRoom = 512;  // of buffered events; at most two vectors more are buffered
static_assert(kRoom + 2 * kLanes <= EventSlots::kChunk);

// Event times of an interval.
class Clock {
 public:
  Clock() = default;
  explicit Clock(const IntervalTimes& t) : h_us_(t.h_us) {
    const double whole = std::floor(t.t0_us);
    base_ = event_key(static_cast<std::int64_t>(whole), 0, false);
    rounding_us_ = static_cast<float>(t.t0_us - whole) + 0.5f;
  }
  // Whole us after floor(t0_us); s: in [0, 1].
  HWY_INLINE hn::Vec<I32> us(V s) const {
    return hn::ConvertTo(I32(), hn::MulAdd(s, hn::Set(F(), h_us_), hn::Set(F(), rounding_us_)));
  }
  // place: a key's lower bits.
  void add(const std::int32_t* us, const std::uint32_t* place, std::size_t count, EventSlots& events) const {
    if (count == 0) return;
    std::int32_t first = us[0], last = us[0];
    for (std::size_t i = 1; i < count; ++i) {
      first = std::min(first, us[i]);
      last = std::max(last, us[i]);
    }
    const auto at = [this](std::int32_t t) { return base_ + (static_cast<EventKey>(t) << kKeyTimeShift); };
    const EventKey next = events.end_of_slot(at(first)), end = at(last + 1);
    if (end <= next) {
      EventKey* const keys = events.room(count, at(first));
      for (std::size_t i = 0; i < count; ++i) keys[i] = at(us[i]) + place[i];
    } else if (end <= events.end_of_slot(next)) {  // events at an interval's end may belong to the next slot
      const auto next_us = static_cast<std::int32_t>((next - base_) >> kKeyTimeShift);
      const auto late = static_cast<std::size_t>(std::count_if(us, us + count, [&](auto t) { return t >= next_us; }));
      EventKey *now = events.room(count - late, at(first)), *then = events.room(late, next);
      for (std::size_t i = 0; i < count; ++i) {
        const bool is_late = us[i] >= next_us;
        *(is_late ? then : now) = at(us[i]) + place[i];
        then += is_late;
        now += !is_late;
      }
    } else {
      for (std::size_t i = 0; i < count; ++i) events.add(at(us[i]) + place[i]);
    }
  }

 private:
  EventKey base_ = 0;
  float h_us_ = 0, rounding_us_ = 0;
};

}  // namespace pecs::sensor::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif
