#pragma once
// Wavelengths to render, and their quadrature weights, so that few bands give the photocurrent (Eq. 5):
//   integral of lambda QE(lambda) L(lambda) d lambda  ~  sum over bands of weight_nm * lambda * QE(lambda) * L(lambda).
#include <vector>

#include "pecs/sensor/spectrum.h"

namespace pecs::sensor {

struct Band {
  double lambda_nm = 0;
  double weight_nm = 0;
  friend bool operator==(const Band&, const Band&) = default;
};

// Gauss quadrature for the weight lambda QE(lambda) E(lambda) on a 1 nm grid over [min_nm, max_nm] (Stieltjes
// recurrence, then Golub & Welsch, Math. Comp. 23, 1969): exact when L / E is a polynomial of degree < 2n.
// `illuminant` is E; null: E = 1. Its table is linear between points: render the lamp the same way.
// Throws bad_input when n does not fit the range or the lamp gives no light there.
std::vector<Band> gauss_bands(const Spectrum& qe, const Spectrum* illuminant, int n, double min_nm, double max_nm);

// The centres of n equal intervals of [min_nm, max_nm].
std::vector<Band> uniform_bands(int n, double min_nm, double max_nm);

}  // namespace pecs::sensor
