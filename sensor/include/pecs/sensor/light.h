#pragma once
// From light to photocurrent: i_p = e/(hc) * area * fill factor * integral of lambda QE(lambda) E(lambda) dlambda
// (Eq. 5 in absolute units), a sum over the stack's bands with their quadrature weights (Eq. 6).
#include <optional>
#include <vector>

#include "pecs/sensor/chip.h"
#include "pecs/sensor/stack.h"

namespace pecs::sensor {

// Amperes in a pixel of the chip per unit of each band's value. A stack of radiance needs the lens's f-number:
// E = pi L / (4 N^2); throws bad_input without it. The pixel's area is the chip's: a stack of coarser pixels (a quick
// render) gives each of them the light of one real pixel.
// With `gain` the light is relative: amperes = gain * lambda_nm * QE (relative) * weight_nm, the paper's C (Eq. 6).
std::vector<double> amperes_per_unit(const Chip& chip, const StackInfo& stack, std::optional<double> fnumber,
                                     std::optional<double> gain = {});

}  // namespace pecs::sensor
