#pragma once
// The folder shared/ that lies beside a developer's checkout (recordings, prescriptions); absent on a user's machine.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

namespace pecs::tests {

inline std::filesystem::path source_dir() { return PECS_SOURCE_DIR; }

inline std::filesystem::path shared_dir() {
  const char* set = std::getenv("PECS_SHARED");
  return set ? std::filesystem::path(set) : source_dir() / ".." / "shared";
}

}  // namespace pecs::tests

// Ends the test as skipped, with a message, when `relative` is not in shared/.
#define PECS_NEEDS_SHARED(relative)                                     \
  if (!std::filesystem::exists(pecs::tests::shared_dir() / (relative))) \
  GTEST_SKIP() << "needs " << (pecs::tests::shared_dir() / (relative)).string()
