#include "pecs/sensor/lux.h"

#include <numeric>

#include "pecs/sensor/named_spectrum.h"
#include "pecs/sensor/photocurrent.h"

namespace pecs::sensor {

std::vector<double> photocurrent_of_lux(const Chip& chip, double lux) {
  const Spectrum lamp = named_spectrum("blackbody:3000"), photopic = named_spectrum("photopic");
  constexpr double kLumens_per_watt = 683;
  double lumens = 0;
  StackInfo light;
  light.quantity = Quantity::irradiance;
  for (double nm = 300.5; nm < 1100; ++nm) {
    light.bands.push_back({nm, lamp.at(nm)});  // weights in the lamp's units; the bands' values are then 1
    lumens += kLumens_per_watt * photopic.at(nm) * lamp.at(nm);
  }
  std::vector<double> out;
  for (const std::vector<double>& amperes : Response(chip, light, amperes_per_unit(chip, light, {})).of_filter)
    out.push_back(std::accumulate(amperes.begin(), amperes.end(), 0.0) * lux / lumens);
  return out;
}

double lux_at_chip(double lux, double fnumber, double reflectance) {
  return lux * reflectance / (4 * fnumber * fnumber);
}

}  // namespace pecs::sensor
