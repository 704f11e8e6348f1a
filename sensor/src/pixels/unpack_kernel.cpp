// Included once per instruction set by Highway's foreach_target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "pixels/unpack_kernel.cpp"
#include <hwy/foreach_target.h>
// then
#include <hwy/highway.h>

#include <bit>
#include <cstddef>

#include "pixels/unpack_kernel.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::sensor::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using U64 = hn::ScalableTag<std::uint64_t>;
using U32 = hn::Repartition<std::uint32_t, U64>;

void UnpackEvents(std::span<const EventKey> keys, std::uint32_t width, events::Event* out) {
  static_assert(std::endian::native == std::endian::little && sizeof(events::Event) == 16 &&
                offsetof(events::Event, x) == 8 && offsetof(events::Event, y) == 10 &&
                offsetof(events::Event, p) == 12);
  const U64 u;
  // pixel / width = pixel * per_width >> shift, exact for pixels of kPixelBits (Granlund & Montgomery, PLDI 1994).
  constexpr int kPixelBits = kKeyTimeShift - kKeyPixelShift;
  const int shift = kPixelBits + static_cast<int>(std::bit_width(width - 1));
  const auto per_width = static_cast<std::uint32_t>(((std::uint64_t{1} << shift) + width - 1) / width);
  const auto times = [](hn::Vec<U64> pixel, std::uint32_t by) {
    return hn::MulEven(hn::BitCast(U32(), pixel), hn::Set(U32(), by));
  };
  std::size_t i = 0;
  for (; i + hn::Lanes(u) <= keys.size(); i += hn::Lanes(u)) {
    const auto key = hn::LoadU(u, keys.data() + i);
    const auto pixel = hn::And(hn::ShiftRight<kKeyPixelShift>(key), hn::Set(u, (std::uint64_t{1} << kPixelBits) - 1));
    const auto y = hn::ShiftRightSame(times(pixel, per_width), shift);
    const auto x = hn::Sub(pixel, times(y, width));
    const auto on = hn::ShiftLeft<32 - kKeyOnShift>(hn::And(key, hn::Set(u, std::uint64_t{1} << kKeyOnShift)));
    hn::StoreInterleaved2(hn::ShiftRight<kKeyTimeShift>(key), hn::Or(on, hn::Or(hn::ShiftLeft<16>(y), x)), u,
                          reinterpret_cast<std::uint64_t*>(out + i));
  }
  for (; i < keys.size(); ++i) {
    const std::uint32_t pixel = key_pixel(keys[i]);
    out[i] = {key_time_us(keys[i]), static_cast<std::uint16_t>(pixel % width),
              static_cast<std::uint16_t>(pixel / width), key_on(keys[i])};
  }
}

}  // namespace pecs::sensor::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace pecs::sensor {
HWY_EXPORT(UnpackEvents);
void unpack_events(std::span<const EventKey> keys, int width, events::Event* out) {
  HWY_DYNAMIC_DISPATCH(UnpackEvents)(keys, static_cast<std::uint32_t>(width), out);
}
}  // namespace pecs::sensor
#endif
