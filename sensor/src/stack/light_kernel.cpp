// Included once per instruction set by Highway's foreach_target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "stack/light_kernel.cpp"
#include <hwy/foreach_target.h>
// then
#include <hwy/highway.h>

#include <cstring>

#include "stack/light_kernel.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::sensor::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Bytes = hn::FixedTag<std::uint8_t, 16>;

void UndoPredictor(std::uint8_t* bytes, std::size_t n) {
  if (n == 0) return;
  const Bytes d;
  // Prefix sums within 16 bytes, then the carry; the first byte has no 128.
  std::uint8_t carry = 128;
  std::size_t i = 0;
  for (; i + 16 <= n; i += 16) {
    auto v = hn::Add(hn::LoadU(d, bytes + i), hn::Set(d, 128));
    v = hn::Add(v, hn::ShiftLeftBytes<1>(d, v));
    v = hn::Add(v, hn::ShiftLeftBytes<2>(d, v));
    v = hn::Add(v, hn::ShiftLeftBytes<4>(d, v));
    v = hn::Add(v, hn::ShiftLeftBytes<8>(d, v));
    v = hn::Add(v, hn::Set(d, carry));
    hn::StoreU(v, d, bytes + i);
    carry = bytes[i + 15];
  }
  for (; i < n; ++i) carry = bytes[i] = static_cast<std::uint8_t>(bytes[i] + 128 + carry);
}

void InterleaveHalves(const std::uint8_t* in, std::uint8_t* out, std::size_t n) {
  const Bytes d;
  const std::uint8_t* second = in + (n + 1) / 2;
  std::size_t i = 0;
  for (; 2 * i + 32 <= n; i += 16) {
    const auto a = hn::LoadU(d, in + i), b = hn::LoadU(d, second + i);
    hn::StoreU(hn::InterleaveLower(d, a, b), d, out + 2 * i);
    hn::StoreU(hn::InterleaveUpper(d, a, b), d, out + 2 * i + 16);
  }
  // Not (k % 2 ? second : in)[k / 2]: GCC 12 with -fsanitize=undefined reads a wrong address there.
  for (std::size_t k = 2 * i; k < n; ++k) out[k] = k % 2 ? second[k / 2] : in[k / 2];
}

using F = hn::ScalableTag<float>;
using U32 = hn::RebindToUnsigned<F>;
using U16 = hn::Rebind<std::uint16_t, F>;

HWY_INLINE hn::Vec<F> to_float(hn::Vec<U16> half) {
  const U32 u;
  const F f;
  const auto h = hn::PromoteTo(u, half);
  const auto magnitude = hn::ShiftLeft<13>(hn::And(h, hn::Set(u, 0x7fff)));
  const auto rebias = hn::Set(u, 112u << 23);
  const auto normal = hn::Add(magnitude, rebias);
  // Subnormal: m 2^-24, from (2^-14 + m 2^-24) - 2^-14.
  const auto least = hn::Set(u, 113u << 23);
  const auto small = hn::BitCast(u, hn::Sub(hn::BitCast(f, hn::Add(magnitude, least)), hn::BitCast(f, least)));
  auto bits = hn::IfThenElse(hn::Lt(magnitude, hn::Set(u, 1u << 23)), small, normal);
  bits = hn::IfThenElse(hn::Gt(magnitude, hn::Set(u, 30u << 23 | 0x7fffffu)), hn::Add(normal, rebias), bits);
  return hn::BitCast(f, hn::Or(bits, hn::ShiftLeft<16>(hn::And(h, hn::Set(u, 0x8000)))));
}

void HalvesToFloats(const std::uint8_t* in, float* out, std::size_t n) {
  const F f;
  const U16 d;
  const std::size_t lanes = hn::Lanes(f);
  std::size_t i = 0;
  HWY_ALIGN std::uint16_t part[hn::MaxLanes(d)] = {};
  for (; i + lanes <= n; i += lanes) {
    std::memcpy(part, in + 2 * i, 2 * lanes);
    hn::StoreU(to_float(hn::Load(d, part)), f, out + i);
  }
  if (i < n) {
    HWY_ALIGN float tail[hn::MaxLanes(f)];
    std::memcpy(part, in + 2 * i, 2 * (n - i));
    hn::Store(to_float(hn::Load(d, part)), f, tail);
    std::memcpy(out + i, tail, sizeof(float) * (n - i));
  }
}

bool WeightedSum(std::span<const float> weights, const float* values, std::span<float> out) {
  const F f;
  const U32 u;
  const std::size_t lanes = hn::Lanes(f), n = out.size();
  const auto largest = hn::Set(u, 0x7f7fffffu);
  auto bad = hn::Zero(u);  // the sign bit is set for a value below 0 or above the largest number
  const auto sum_at = [&](auto&& load) {
    auto sum = hn::Zero(f);
    for (std::size_t b = 0; b < weights.size(); ++b) {
      const auto v = load(values + b * n);
      sum = hn::MulAdd(hn::Set(f, weights[b]), v, sum);
      const auto bits = hn::BitCast(u, v);
      bad = hn::Or(bad, hn::Or(bits, hn::Sub(largest, bits)));
    }
    return sum;
  };
  std::size_t i = 0;
  for (; i + lanes <= n; i += lanes)
    hn::StoreU(sum_at([&](const float* plane) { return hn::LoadU(f, plane + i); }), f, out.data() + i);
  if (i < n) {
    HWY_ALIGN float part[hn::MaxLanes(f)] = {};
    const auto sum = sum_at([&](const float* plane) {
      std::memcpy(part, plane + i, sizeof(float) * (n - i));
      return hn::Load(f, part);
    });
    hn::Store(sum, f, part);
    std::memcpy(out.data() + i, part, sizeof(float) * (n - i));
  }
  return !hn::AllTrue(u, hn::Lt(bad, hn::Set(u, 0x80000000u)));
}

}  // namespace pecs::sensor::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace pecs::sensor {
HWY_EXPORT(UndoPredictor);
HWY_EXPORT(InterleaveHalves);
HWY_EXPORT(HalvesToFloats);
HWY_EXPORT(WeightedSum);
void undo_predictor(std::span<std::uint8_t> bytes) { HWY_DYNAMIC_DISPATCH(UndoPredictor)(bytes.data(), bytes.size()); }
void interleave_halves(std::span<const std::uint8_t> in, std::span<std::uint8_t> out) {
  HWY_DYNAMIC_DISPATCH(InterleaveHalves)(in.data(), out.data(), in.size());
}
void halves_to_floats(const std::uint8_t* in, std::span<float> out) {
  HWY_DYNAMIC_DISPATCH(HalvesToFloats)(in, out.data(), out.size());
}
bool weighted_sum(std::span<const float> weights, const float* values, std::span<float> out) {
  return HWY_DYNAMIC_DISPATCH(WeightedSum)(weights, values, out);
}
}  // namespace pecs::sensor
#endif
