// State of the pixels of a block, and of vectors of those that may fire. Included once per instruction set.
#if defined(PECS_ACTIVE_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef PECS_ACTIVE_LANES_INL_H_
#undef PECS_ACTIVE_LANES_INL_H_
#else
#define PECS_ACTIVE_LANES_INL_H_
#endif

#include <bit>

#include "models/pecs/math-inl.h"
#include "models/pecs/random-inl.h"
// then
#include "models/pecs/amplifier.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::sensor::HWY_NAMESPACE {

inline std::uint32_t lanes() { return static_cast<std::uint32_t>(hn::Lanes(F())); }
HWY_INLINE V at(const float* row, std::uint32_t p) { return hn::Load(F(), row + p); }
HWY_INLINE void put(V v, float* row, std::uint32_t p) { hn::Store(v, F(), row + p); }

// A block of pixels: rows with one value per pixel, padded to whole vectors. Index of l, i, g: frame at the interval's
// start, at its end, the one after; index of the other pairs: start, end.
struct BlockRows {
  static constexpr std::uint32_t kPixels = 2048;
  std::uint32_t first = 0, count = 0;
  HWY_ALIGN float memory[25][kPixels];
  float* l[3] = {memory[0], memory[1], memory[2]};  // ln I
  float* i[3] = {memory[3], memory[4], memory[5]};  // photo- plus dark current I [fA]
  float* g[3] = {memory[6], memory[7], memory[8]};  // 1/I
  float* m[2] = {memory[9], memory[10]};            // slope of ln I [1/us]
  float* w[2] = {memory[11], memory[12]};           // photoreceptor: 1/u
  float* v[2] = {memory[13], memory[14]};           // ln u
  float* u[2] = {memory[15], memory[16]};
  float* y[2] = {memory[17], memory[18]};  // output of the amplifier
  float* n[2] = {memory[19], memory[20]};  // noise of the photoreceptor
  float* z[2] = {memory[21], memory[22]};  // noise that the amplifier passes
  float* e[2] = {memory[23], memory[24]};  // slow part of the steps by exposures
  HWY_ALIGN float reference[kPixels], blind_us[kPixels], on[kPixels], off[kPixels];
  // Values of an interval: integral of the noise's rate, and its standard deviation; gate: ActivePixels::examine.
  HWY_ALIGN float relaxation[kPixels], noise_std[kPixels], gate[kPixels];
};

inline float a_h_of(const KernelArguments& a, const IntervalTimes& t) {
  return static_cast<float>(a.constants.a_per_us) * t.h_us;
}
// An interval in time constants of the slow part.
inline float slow_h_of(const KernelArguments& a, const IntervalTimes& t) {
  return t.h_us / static_cast<float>(a.exposures.slow_us);
}

// A pixel in whose interval few crossings are expected is at work with their probability. Its number in [0, 1), the
// gate, then also chooses the part of the interval: it must be used once.
constexpr float kNoGate = 2, kShut = 1, kFree = -1;
constexpr std::size_t kDepth = 32;  // of parts of a step

// A vector of pixels that may fire. Times are s in [0, 1] within the interval, z in [0, 1] within a step of the
// photoreceptor, or u in [0, 1] within a part of a step.
struct ActiveLanes {
  // 1 or 0. A live pixel is ready for its next step, in a leaf, or has a part of a step to examine, which is split
  // before where `splits`.
  HWY_ALIGN float live[kLanes], ready[kLanes], splits[kLanes], leaf[kLanes];
  HWY_ALIGN float on[kLanes], off[kLanes], reference[kLanes], blind[kLanes];
  HWY_ALIGN float background[kLanes], exposure[kLanes];  // next of DueEvents
  HWY_ALIGN float wakes_before[kLanes];                  // refractory periods that end later end in the next step
  HWY_ALIGN float light[4][kLanes], steepest[kLanes], steepest_second[kLanes];
  HWY_ALIGN float s[kLanes], w[kLanes], i[kLanes], slope[kLanes], v[kLanes];  // state of the photoreceptor
  HWY_ALIGN float y[kLanes], e[kLanes];                    // of the amplifier; slow part of the steps by exposures
  HWY_ALIGN float follows[kLanes], relaxes[kLanes];        // its motion
  HWY_ALIGN float ds[kLanes], s_next[kLanes], m0[kLanes];  // of the next step
  HWY_ALIGN float q[4][kLanes], s0[kLanes], s1[kLanes];    // of the last step: V with the leak
  // Noise: its state at the interval's end (not known where free: the light is too fast for one rate), and where the
  // step ends; rate: integral over the interval.
  HWY_ALIGN float n_last[kLanes], z_last[kLanes], free[kLanes], n_step[kLanes], z_step[kLanes];
  HWY_ALIGN float rate[kLanes], std[kLanes], gate[kLanes];
  // The part of the step at work, with its noise at both ends, and the parts after it, the nearest last.
  HWY_ALIGN float from[kLanes], n0[kLanes], z0[kLanes], to[kLanes], n1[kLanes], z1[kLanes];
  HWY_ALIGN float later_to[kDepth][kLanes], later_n[kDepth][kLanes], later_z[kDepth][kLanes];
  HWY_ALIGN std::uint32_t later[kLanes];  // their number
  LaneSequence random;
  // A crossing by noise that is one if none precedes it: at the end of the part with `candidate_later` later ones.
  HWY_ALIGN float candidate[kLanes];  // 1: ON, -1: OFF, 0: none
  HWY_ALIGN std::uint32_t candidate_later[kLanes];
  HWY_ALIGN float next[kLanes], next_on[kLanes];  // crossing: u
  HWY_ALIGN std::uint32_t pixels[kLanes];
};
// work(lane) for each lane of a mask.
template <class Work>
HWY_INLINE void each(M which, const Work& work) {
  std::uint8_t bits[8] = {};
  hn::StoreMaskBits(F(), which, bits);
  std::uint32_t left = bits[0] | static_cast<std::uint32_t>(bits[1]) << 8;
  for (; left != 0; left &= left - 1) work(static_cast<std::size_t>(std::countr_zero(left)));
}
static_assert(kLanes <= 16);
HWY_INLINE V get(const float* row) { return hn::Load(F(), row); }
HWY_INLINE void set(float* row, V v) { hn::Store(v, F(), row); }
HWY_INLINE M holds(const float* row) { return hn::Gt(get(row), hn::Zero(F())); }
HWY_INLINE void set(float* row, M m) { set(row, hn::IfThenElseZero(m, hn::Set(F(), 1.0f))); }
HWY_INLINE Cubic<V> cubic(const float (*rows)[kLanes]) {
  return {get(rows[0]), get(rows[1]), get(rows[2]), get(rows[3])};
}
HWY_INLINE void set(float (*rows)[kLanes], const Cubic<V>& c) {
  set(rows[0], c.c0), set(rows[1], c.c1), set(rows[2], c.c2), set(rows[3], c.c3);
}

// The part of a step as a cubic in u, without noise.
HWY_INLINE Cubic<V> part_of(const ActiveLanes& g) {
  const Cubic<V> q = cubic(g.q);
  const V from = get(g.from), to = get(g.to), length = hn::Sub(to, from);
  return hermite(q.at(from), q.at(to), hn::Mul(length, q.slope(from)), hn::Mul(length, q.slope(to)));
}
HWY_INLINE V time_of(const ActiveLanes& g, V z) { return hn::MulAdd(hn::Sub(get(g.s1), get(g.s0)), z, get(g.s0)); }

}  // namespace pecs::sensor::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif
