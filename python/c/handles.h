#pragma once
// Handles that several files open up.
#include "pecs/sensor/stack.h"

struct pecs_stack_reader {
  pecs::sensor::StackReader reader;
};
