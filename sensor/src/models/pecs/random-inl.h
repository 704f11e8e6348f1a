// random.h for a vector of pixels. Included once per instruction set.
#if defined(PECS_RANDOM_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef PECS_RANDOM_INL_H_
#undef PECS_RANDOM_INL_H_
#else
#define PECS_RANDOM_INL_H_
#endif

#include "models/pecs/math-inl.h"
#include "pecs/sensor/random.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::sensor::HWY_NAMESPACE {

// High and low halves of the products of 32-bit lanes with a number.
HWY_INLINE void multiply(VU a, std::uint32_t by, VU& high, VU& low) {
  const U32 u;
  const hn::RepartitionToWide<U32> wide;
  const VU b = hn::Set(u, by);
  const auto even = hn::MulEven(a, b), odd = hn::MulEven(hn::BitCast(u, hn::ShiftRight<32>(hn::BitCast(wide, a))), b);
  high = hn::OddEven(hn::BitCast(u, odd), hn::BitCast(u, hn::ShiftRight<32>(even)));
  low = hn::OddEven(hn::BitCast(u, hn::ShiftLeft<32>(odd)), hn::BitCast(u, even));
}

// random.h: philox for a vector of counters.
HWY_INLINE void philox(VU c[4], std::uint64_t key) {
  const U32 u;
  auto k0 = static_cast<std::uint32_t>(key), k1 = static_cast<std::uint32_t>(key >> 32);
  for (int round = 0; round < 7; ++round) {
    VU ah, al, bh, bl;
    multiply(c[0], 0xD2511F53u, ah, al);
    multiply(c[2], 0xCD9E8D57u, bh, bl);
    c[0] = hn::Xor(hn::Xor(bh, c[1]), hn::Set(u, k0));
    c[2] = hn::Xor(hn::Xor(ah, c[3]), hn::Set(u, k1));
    c[1] = bl;
    c[3] = al;
    k0 += 0x9E3779B9;
    k1 += 0xBB67AE85;
  }
}

// random.h: random4 for a vector of pixels.
struct Four {
  VU r[4];
  VU operator[](std::size_t k) const { return r[k]; }
};
HWY_INLINE Four random_of(VU pixels, std::int64_t step, Purpose purpose, std::uint64_t seed) {
  const U32 u;
  const auto s = static_cast<std::uint64_t>(step);
  Four out{{pixels, hn::Set(u, static_cast<std::uint32_t>(s)), hn::Set(u, static_cast<std::uint32_t>(s >> 32)),
            hn::Set(u, static_cast<std::uint32_t>(purpose))}};
  philox(out.r, seed);
  return out;
}

// A sequence for each lane, faster than Philox, which gives its start: Doty-Humphrey's sfc32 (PractRand 0.94).
struct LaneSequence {
  HWY_ALIGN std::uint32_t a[kLanes], b[kLanes], c[kLanes], count[kLanes];

  // Starts the lanes of `in`.
  HWY_INLINE void start(M in, const Four& random) {
    const auto put = [&](std::uint32_t* row, VU v) { advance(in, row, v); };
    put(a, random[0]), put(b, random[1]), put(c, random[2]), put(count, hn::Set(U32(), 1));
  }
  // The next number, where `which`.
  HWY_INLINE VU next(M which) {
    const U32 u;
    const VU a0 = hn::Load(u, a), b0 = hn::Load(u, b), c0 = hn::Load(u, c), n = hn::Load(u, count);
    const VU out = hn::Add(hn::Add(a0, b0), n);
    advance(which, a, hn::Xor(b0, hn::ShiftRight<9>(b0)));
    advance(which, b, hn::Add(c0, hn::ShiftLeft<3>(c0)));
    advance(which, c, hn::Add(hn::Or(hn::ShiftLeft<21>(c0), hn::ShiftRight<11>(c0)), out));
    advance(which, count, hn::Add(n, hn::Set(u, 1)));
    return out;
  }
  std::uint32_t next(std::size_t lane) {
    const std::uint32_t out = a[lane] + b[lane] + count[lane]++;
    a[lane] = b[lane] ^ b[lane] >> 9;
    b[lane] = c[lane] + (c[lane] << 3);
    c[lane] = std::rotl(c[lane], 21) + out;
    return out;
  }

 private:
  static HWY_INLINE void advance(M which, std::uint32_t* row, VU v) {
    const U32 u;
    hn::Store(hn::IfThenElse(hn::RebindMask(u, which), v, hn::Load(u, row)), u, row);
  }
};

// random.h: uniform, also for the smallest.
HWY_INLINE V uniform(VU r) {
  const F f;
  const I32 i;
  const auto half = [&](VU bits) { return hn::ConvertTo(f, hn::BitCast(i, bits)); };
  const V low = hn::MulAdd(half(hn::And(r, hn::Set(U32(), 0xffffu))), hn::Set(f, 0x1p-32f), hn::Set(f, 0x1p-33f));
  return hn::MulAdd(half(hn::ShiftRight<16>(r)), hn::Set(f, 0x1p-16f), low);
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

}  // namespace pecs::sensor::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif
