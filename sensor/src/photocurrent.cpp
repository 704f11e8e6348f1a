#include "pecs/sensor/photocurrent.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "pecs/error.h"
#include "pecs/sensor/random.h"

namespace pecs::sensor {

std::vector<double> amperes_per_unit(const Chip& chip, const StackInfo& stack, const LightOptions& options) {
  constexpr double kElectron_c = 1.602176634e-19, kPlanck_js = 6.62607015e-34, kLight_m_per_s = 299792458;
  const bool absolute = stack.quantity != Quantity::relative && !options.gain;
  double film_per_value = 1;
  if (stack.quantity == Quantity::radiance && absolute) {
    if (!options.fnumber)
      throw bad_input("stack", "quantity", "radiance without --fnumber", "the lens's f-number, or --gain");
    film_per_value = std::numbers::pi / (4 * *options.fnumber * *options.fnumber);
  }
  const double area_m2 = chip.pixel_pitch_m * chip.pixel_pitch_m * chip.fill_factor;
  std::vector<double> weights;
  double total = 0;
  for (const Band& band : stack.bands) {
    const double relative = band.lambda_nm * chip.relative_qe.at(band.lambda_nm);
    const double amperes_per_watt =  // Eq. 3 solved for R
        chip.peak_qe * relative * 1e-9 * kElectron_c / (kPlanck_js * kLight_m_per_s);
    weights.push_back((absolute ? film_per_value * area_m2 * amperes_per_watt : relative) * band.weight_nm);
    total += weights.back();
  }
  if (!(total > 0)) throw bad_input("stack", "bands", "no band where the chip sees", "at least one");
  if (!absolute) {
    const double scale = options.gain ? *options.gain : options.photocurrent_a.value_or(kDefaultWhite_a) / total;
    for (double& w : weights) w *= scale;
  }
  return weights;
}

std::vector<double> monte_carlo(const std::vector<double>& amperes, const std::vector<double>& mean_light, int n,
                                std::uint64_t seed) {
  std::vector<double> share;  // cumulated
  double total = 0;
  for (std::size_t b = 0; b < amperes.size(); ++b) share.push_back(total += amperes[b] * std::max(0.0, mean_light[b]));
  if (!(total > 0)) throw bad_input("stack", "first frame", "no light", "light to draw bands by");
  std::vector<double> weights(amperes.size());
  for (int k = 0; k < n; ++k) {
    const double u = total * uniform(random4(seed, static_cast<std::uint32_t>(k), 0, Purpose::bands)[0]);
    const auto b = static_cast<std::size_t>(std::ranges::upper_bound(share, u) - share.begin());
    const double p = amperes[b] * mean_light[b] / total;  // Eq. 10
    weights[b] += amperes[b] / (n * p);                   // Eq. 11
  }
  return weights;
}

}  // namespace pecs::sensor
