#include "pecs/sensor/spectrum.h"

#include <algorithm>

namespace pecs::sensor {

double Spectrum::at(double wavelength_nm) const {
  if (lambda_nm.empty() || wavelength_nm < min_nm() || wavelength_nm > max_nm()) return 0;
  const auto above = std::upper_bound(lambda_nm.begin(), lambda_nm.end(), wavelength_nm);
  if (above == lambda_nm.end()) return value.back();
  const auto i = static_cast<std::size_t>(above - lambda_nm.begin());
  const double f = (wavelength_nm - lambda_nm[i - 1]) / (lambda_nm[i] - lambda_nm[i - 1]);
  return value[i - 1] + f * (value[i] - value[i - 1]);
}

}  // namespace pecs::sensor
