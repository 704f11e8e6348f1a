#pragma once
// Finds data files that ship with the program (lenses, glasses, chips) by name.
#include <filesystem>
#include <string>

namespace pecs {

// The path of `name_or_path`: the argument itself if it has a folder or ends in ".json", otherwise
// "<data>/<folder>/<name>.json" ("dgauss_50mm" in folder "lens_data/lenses"). <data> is $PECS_DATA if set, otherwise
// "share/pecs" or the checkout above the running program or library. Throws not_found, which lists the available names.
std::filesystem::path find_data(const std::string& folder, const std::string& name_or_path);

// The folder of `folder` itself; throws not_found.
std::filesystem::path data_dir(const std::string& folder);

}  // namespace pecs
