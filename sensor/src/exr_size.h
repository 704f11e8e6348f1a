#pragma once
#include <ImfHeader.h>

#include <filesystem>

namespace pecs::sensor {

// Throws bad_input when the header declares more pixels than the file can hold, however well it packs them. Before
// anything of that size is allocated.
void check_declared_size(const Imf::Header& header, const std::filesystem::path& path);

}  // namespace pecs::sensor
