#pragma once
// A tabulated function of wavelength: linear between its points, zero outside them.
#include <vector>

namespace pecs::sensor {

struct Spectrum {
  std::vector<double> lambda_nm;  // rising
  std::vector<double> value;

  double at(double wavelength_nm) const;
  double min_nm() const { return lambda_nm.front(); }
  double max_nm() const { return lambda_nm.back(); }
};

}  // namespace pecs::sensor
