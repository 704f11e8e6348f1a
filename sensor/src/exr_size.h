#pragma once
#include <ImfHeader.h>

#include <filesystem>

namespace pecs::sensor {

// Throws bad_input when the header declares more pixels than the file can hold, however well it packs them. Before
// anything of that size is allocated.
void check_declared_size(const Imf::Header& header, const std::filesystem::path& path);

// Throws bad_input for an attribute of the header that is longer than the file, which OpenEXR would allocate, or of
// another length than its type has: OpenEXR would take its end for attributes of their own.
void check_attributes(const std::filesystem::path& path);

}  // namespace pecs::sensor
