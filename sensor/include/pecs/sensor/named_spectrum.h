#pragma once
// Spectra by name.
#include <filesystem>
#include <string>
#include <vector>

#include "pecs/sensor/spectrum.h"

namespace pecs::sensor {

// "d65", "colorchecker/red": of lens_data/spectra; "lamp.csv", "./lamp.txt": a file; "blackbody:T" (Planck, 300 to 1100
// nm), "daylight:T" (CIE D series), T in kelvin. Throws not_found, naming what there is, and bad_input.
Spectrum named_spectrum(const std::string& name_or_path);

// A table of numbers: columns separated by commas or blanks, wavelengths [nm] first and rising; '#' starts a comment,
// and names of columns may stand above. Throws bad_input, naming the line.
std::vector<std::vector<double>> read_table(const std::filesystem::path& path, std::size_t columns);

}  // namespace pecs::sensor
