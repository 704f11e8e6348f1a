#include "pecs/data_dir.h"

#include <fmt/ranges.h>

#include <set>

#include "pecs/error.h"
#include "pecs/platform.h"

namespace pecs {
namespace fs = std::filesystem;

fs::path data_dir(const std::string& folder) {
  if (const auto set = platform::environment("PECS_DATA"); set && !set->empty()) {
    if (fs::path dir = fs::path(*set) / folder; fs::is_directory(dir)) return dir;
    throw not_found((fs::path(*set) / folder).string(), "no such folder (PECS_DATA is set)");
  }
  // build/<preset>/bin/pecs is four levels below the checkout's root, bin/pecs two below the prefix.
  fs::path above = platform::own_binary().parent_path();
  for (int level = 0; level < 5 && above.has_relative_path(); ++level, above = above.parent_path())
    for (const fs::path& dir : {above / "share" / "pecs" / folder, above / folder})
      if (fs::is_directory(dir)) return dir;
  throw not_found(folder, "no such data folder near the program; set PECS_DATA to the folder that contains it");
}

fs::path find_data(const std::string& folder, const std::string& name_or_path) {
  if (fs::path(name_or_path).has_parent_path() || name_or_path.ends_with(".json")) return name_or_path;
  const fs::path dir = data_dir(folder);
  if (fs::path path = dir / (name_or_path + ".json"); fs::is_regular_file(path)) return path;
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(dir))
    if (entry.path().extension() == ".json") names.insert(entry.path().stem().string());
  throw not_found(name_or_path, fmt::format("no file, and none of {}", fmt::join(names, ", ")));
}

}  // namespace pecs
