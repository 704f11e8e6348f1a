#include "pecs/sensor/light.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "pecs/error.h"

namespace pecs::sensor {

std::vector<double> amperes_per_unit(const Chip& chip, const StackInfo& stack, std::optional<double> fnumber,
                                     std::optional<double> gain) {
  constexpr double kElectron_c = 1.602176634e-19, kPlanck_js = 6.62607015e-34, kLight_m_per_s = 299792458;
  double film_per_value = 1;
  if (stack.quantity == Quantity::radiance && !gain) {
    if (!fnumber) throw bad_input("stack", "quantity", "radiance without --fnumber", "the lens's f-number, or --gain");
    film_per_value = std::numbers::pi / (4 * *fnumber * *fnumber);
  }
  const double area_m2 = chip.pixel_pitch_m * chip.pixel_pitch_m * chip.fill_factor;
  std::vector<double> weights;
  double total = 0;
  for (const Band& band : stack.bands) {
    const double lambda_m = band.lambda_nm * 1e-9;
    const double amperes_per_watt =  // Eq. 3 solved for R
        chip.peak_qe * chip.relative_qe.at(band.lambda_nm) * lambda_m * kElectron_c / (kPlanck_js * kLight_m_per_s);
    const double relative = band.lambda_nm * chip.relative_qe.at(band.lambda_nm);
    weights.push_back((gain ? *gain * relative : film_per_value * area_m2 * amperes_per_watt) * band.weight_nm);
    total += weights.back();
  }
  if (!(total > 0)) throw bad_input("stack", "bands", "no band where the chip sees", "at least one");
  return weights;
}

}  // namespace pecs::sensor
