#pragma once
// Data files that ship with the program (lenses, glasses, chips), found by name.
#include <filesystem>
#include <string>

namespace pecs {

// The file that the user means by `name_or_path`: itself when it holds a '/' or ends in ".json", else
// "<data>/<room>/<name>.json" ("dgauss_50mm" in room "lens_data/lenses"). <data> is $PECS_DATA when set, else
// "share/pecs" or the checkout above the running program or library. Throws not_found, naming what there is.
std::filesystem::path find_data(const std::string& room, const std::string& name_or_path);

// The folder of `room` itself; throws not_found.
std::filesystem::path data_dir(const std::string& room);

}  // namespace pecs
