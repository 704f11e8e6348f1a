#pragma once
// From light to photocurrent: i_p = e/(hc) * area * fill factor * integral of lambda QE(lambda) E(lambda) dlambda
// (Eq. 5 in absolute units), a sum over the stack's bands with their quadrature weights (Eq. 6).
#include <cstdint>
#include <optional>
#include <vector>

#include "pecs/sensor/chip.h"
#include "pecs/sensor/stack.h"

namespace pecs::sensor {

struct LightOptions {
  std::optional<double> fnumber;         // of the lens, for radiance: E = pi L / (4 N^2)
  std::optional<double> gain;            // for relative units: amperes = gain * lambda_nm * QE * weight_nm, Eq. 6's C
  std::optional<double> photocurrent_a;  // of relative light 1 in all bands
};
inline constexpr double kDefaultWhite_a = 1e-12;

// Amperes in a pixel of the chip per unit of each band's value. The pixel's area is the chip's: a stack of coarser
// pixels (a quick render) gives each of them the light of one real pixel. Throws bad_input for radiance with neither
// f-number nor gain, and when the chip sees none of the bands.
std::vector<double> amperes_per_unit(const Chip& chip, const StackInfo& stack, const LightOptions& options);

// Monte Carlo instead of the sum over all bands (Eq. 8-11): `n` bands are drawn with the probability of their share in
// the mean light, `mean_light` of each band, and weighted by its inverse. The same bands for all pixels. Bands that
// were not drawn get 0.
std::vector<double> monte_carlo(const std::vector<double>& amperes, const std::vector<double>& mean_light, int n,
                                std::uint64_t seed);

}  // namespace pecs::sensor
