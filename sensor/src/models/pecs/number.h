// The number types of the pixel's equations (cubic.h, photoreceptor.h): a type T brings + - * / and comparisons, also
// with float constants, and the functions below. Here: float and double; math-inl.h: Highway's vectors of floats.
//
// With Highway, include math-inl.h first: these headers are then compiled once per instruction set. Without it (tests,
// a .cu file, which may define PECS_INLINE), they are compiled once, in namespace pecs::sensor::scalar.
#if defined(PECS_NUMBER_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef PECS_NUMBER_H_
#undef PECS_NUMBER_H_
#else
#define PECS_NUMBER_H_
#endif

#include <algorithm>
#include <cmath>
#include <concepts>
#include <utility>

#ifndef PECS_BEGIN_NUMBERS
#ifdef HWY_BEFORE_NAMESPACE
#define PECS_BEGIN_NUMBERS \
  HWY_BEFORE_NAMESPACE();  \
  namespace pecs::sensor::HWY_NAMESPACE {
#define PECS_END_NUMBERS \
  }                      \
  HWY_AFTER_NAMESPACE();
#define PECS_INLINE HWY_INLINE
#else
#define PECS_BEGIN_NUMBERS namespace pecs::sensor::scalar {
#define PECS_END_NUMBERS }
#ifndef PECS_INLINE
#define PECS_INLINE inline
#endif
#endif
#endif

PECS_BEGIN_NUMBERS

template <class T>
using MaskOf = decltype(std::declval<T>() < std::declval<T>());

template <std::floating_point T>
PECS_INLINE T number(double value) {
  return static_cast<T>(value);
}
template <std::floating_point T>
PECS_INLINE T mul_add(T a, T b, T c) {
  return a * b + c;
}
template <std::floating_point T>
PECS_INLINE T mul_sub(T a, T b, T c) {
  return a * b - c;
}
template <std::floating_point T>
PECS_INLINE T neg_mul_add(T a, T b, T c) {
  return c - a * b;
}
template <std::floating_point T>
PECS_INLINE T select(bool which, T yes, T no) {
  return which ? yes : no;
}
template <std::floating_point T>
PECS_INLINE T select_or_zero(bool which, T yes) {
  return which ? yes : T{0};
}
template <std::floating_point T>
PECS_INLINE T copy_sign(T size, T sign) {
  return std::copysign(size, sign);
}
PECS_INLINE bool all(bool mask) { return mask; }
PECS_INLINE bool any(bool mask) { return mask; }
using std::abs, std::ceil, std::exp, std::log, std::max, std::min, std::sqrt;

PECS_END_NUMBERS
#endif
