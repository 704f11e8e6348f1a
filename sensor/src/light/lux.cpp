#include "pecs/sensor/lux.h"

#include "pecs/data_dir.h"
#include "pecs/sensor/named_spectrum.h"
#include "pecs/sensor/photocurrent.h"

namespace pecs::sensor {

double photocurrent_of_lux(const Chip& chip, double lux) {
  const Spectrum lamp = named_spectrum("blackbody:3000"), photopic = named_spectrum("photopic");
  constexpr double kLumens_per_watt = 683;
  double lumens = 0;
  StackInfo light;
  light.quantity = Quantity::irradiance;
  for (double nm = 300.5; nm < 1100; ++nm) {
    light.bands.push_back({nm, lamp.at(nm)});  // weights in the lamp's units; the bands' values are then 1
    lumens += kLumens_per_watt * photopic.at(nm) * lamp.at(nm);
  }
  double amperes = 0;
  for (const double a : amperes_per_unit(chip, light, {})) amperes += a;
  return amperes * lux / lumens;
}

double lux_at_chip(double lux, double fnumber, double reflectance) {
  return lux * reflectance / (4 * fnumber * fnumber);
}

}  // namespace pecs::sensor
