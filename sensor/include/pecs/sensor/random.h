#pragma once
// Counter-based random numbers: a value depends on (seed, pixel, step, purpose) only, never on the order of the work.
// Philox4x32 with 7 rounds (Salmon, Moraes, Dror, Shaw: Parallel random numbers: as easy as 1, 2, 3; SC 2011).
#include <array>
#include <cmath>
#include <cstdint>

namespace pecs::sensor {

enum class Purpose : std::uint32_t {
  threshold = 1,
  noise_start,
  noise,
  background,
  hot,
  model,
  readout,
  bands,
  path,
  frame,
  exposure
};

using Random4 = std::array<std::uint32_t, 4>;

template <int kRounds = 7>
constexpr Random4 philox(Random4 c, std::uint64_t key) {
  auto k0 = static_cast<std::uint32_t>(key), k1 = static_cast<std::uint32_t>(key >> 32);
  for (int round = 0; round < kRounds; ++round) {
    const std::uint64_t a = std::uint64_t{0xD2511F53} * c[0], b = std::uint64_t{0xCD9E8D57} * c[2];
    c = {static_cast<std::uint32_t>(b >> 32) ^ c[1] ^ k0, static_cast<std::uint32_t>(b),
         static_cast<std::uint32_t>(a >> 32) ^ c[3] ^ k1, static_cast<std::uint32_t>(a)};
    k0 += 0x9E3779B9;
    k1 += 0xBB67AE85;
  }
  return c;
}

constexpr Random4 random4(std::uint64_t seed, std::uint32_t pixel, std::int64_t step, Purpose purpose) {
  const auto s = static_cast<std::uint64_t>(step);
  return philox(
      {pixel, static_cast<std::uint32_t>(s), static_cast<std::uint32_t>(s >> 32), static_cast<std::uint32_t>(purpose)},
      seed);
}

// In (0, 1).
constexpr double uniform(std::uint32_t r) { return (r + 0.5) * 0x1p-32; }

// Standard normal by the inverse error function (Giles, GPU Computing Gems 2, ch. 10, single precision: 1e-6).
inline double gaussian(std::uint32_t r) {
  const double x = 2 * uniform(r) - 1;
  double w = -std::log((1 - x) * (1 + x));
  double p;
  if (w < 5) {
    w -= 2.5;
    p = 2.81022636e-08;
    for (const double c : {3.43273939e-07, -3.5233877e-06, -4.39150654e-06, 0.00021858087, -0.00125372503,
                           -0.00417768164, 0.246640727, 1.50140941})
      p = p * w + c;
  } else {
    w = std::sqrt(w) - 3;
    p = -0.000200214257;
    for (const double c : {0.000100950558, 0.00134934322, -0.00367342844, 0.00573950773, -0.0076224613, 0.00943887047,
                           1.00167406, 2.83297682})
      p = p * w + c;
  }
  return 1.4142135623730951 * p * x;
}

}  // namespace pecs::sensor
