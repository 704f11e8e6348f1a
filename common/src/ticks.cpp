#include "pecs/ticks.h"

#include <algorithm>
#include <cmath>

namespace pecs {

std::vector<double> ticks(double low, double high, int wanted) {
  const double raw = std::max(high - low, 1e-12) / wanted, power = std::pow(10, std::floor(std::log10(raw)));
  double step = 10 * power;
  for (const double m : {5.0, 2.0, 1.0})
    if (m * power >= raw) step = m * power;
  std::vector<double> out;
  for (double t = std::ceil(low / step - 1e-9) * step + 0.0; t <= high + 1e-9 * step; t += step) out.push_back(t);
  return out;
}

}  // namespace pecs
