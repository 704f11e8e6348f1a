#pragma once
// Handles and structures of pecs.h that several files open up.
#include "pecs.h"
#include "pecs/sensor/sense.h"
#include "pecs/sensor/stack.h"

struct pecs_stack_reader {
  pecs::sensor::StackReader reader;
};

namespace pecs::capi {

// Selects the caller's model; NULL: that of the options.
void use_model(const pecs_model* model, sensor::ModelChoice& choice);

}  // namespace pecs::capi
