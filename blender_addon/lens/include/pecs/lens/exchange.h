#pragma once
// Prescriptions of other programs. Importers return a lens in the form of lens_data/SCHEMA.md and reject features that
// it does not support.
#include <string>

#include "pecs/lens/prescription.h"
#include "pecs/strict_json.h"

namespace pecs::lens {

// Zemax sequential .zmx (text, UTF-8 or UTF-16): STANDARD, EVENASPH and ODDASPHE surfaces, units MM, CM, IN or METER.
// Glass by name (glass_of_name), otherwise by nd and Vd of the GLAS line unless they are Zemax's placeholder;
// substitutions are in "notes". ENPD and FNUM determine the stop, CLAP limits it. Surfaces without DIAM or CLAP are
// rejected, and apertures that are no open circle; planes between air and air are discarded unless they block light.
Json import_zmx(const std::string& bytes, const std::string& file);

// pbrt's lens text: radius, thickness, index, aperture diameter [mm] per line, front to rear, radius 0 = stop.
Json import_pbrt(const std::string& text, const std::string& file);

// The same text; index at lambda_nm, the last thickness is the film's distance. Aspheres are unsupported.
std::string export_pbrt(const Prescription& lens, double lambda_nm, double film_z_mm);

}  // namespace pecs::lens
