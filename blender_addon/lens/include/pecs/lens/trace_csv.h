#pragma once
// Bundles of rays as text: x,y,z,dx,dy,dz in, the same and a status out (docs/reference/lens.md).
#include <cstdio>
#include <iosfwd>
#include <string>

#include "pecs/lens/trace.h"

namespace pecs::lens {

// Rays with dz > 0 run to the film, others to the scene; those that pass are written on the plane z = to_z_mm. Throws
// bad_input with the line of `name`, after writing the lines before it.
void trace_csv(std::istream& in, const std::string& name, std::FILE* out, const Tracer& tracer, Tracer::Clip clip,
               double to_z_mm);

}  // namespace pecs::lens
