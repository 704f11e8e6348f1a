#pragma once
// From illuminance to photocurrent, by the light that Prophesee's definitions use: a black body of 3000 K.
#include <vector>

#include "pecs/sensor/chip.h"

namespace pecs::sensor {

// Photocurrent [A] of a pixel, without dark current, for an illuminance [lux] of the chip, behind each of its filters.
std::vector<double> photocurrent_of_lux(const Chip& chip, double lux);

// Illuminance of the chip behind a lens of this f-number that sees a white surface of illuminance `lux`:
// lux reflectance / (4 N^2).
double lux_at_chip(double lux, double fnumber, double reflectance);

}  // namespace pecs::sensor
