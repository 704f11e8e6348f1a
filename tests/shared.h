#pragma once
// The folder shared/ next to a developer's checkout (recordings, prescriptions); absent on a user's machine.
// And errors of calls.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <functional>
#include <string>

#include "pecs/error.h"

namespace pecs::tests {

inline std::filesystem::path source_dir() { return PECS_SOURCE_DIR; }

inline std::filesystem::path shared_dir() {
  const char* set = std::getenv("PECS_SHARED");
  return set ? std::filesystem::path(set) : source_dir() / ".." / "shared";
}

// The error of `f`, one line; empty without one.
inline std::string error_of(const std::function<void()>& f, ExitCode* code = nullptr) {
  try {
    f();
  } catch (const Error& e) {
    EXPECT_EQ(std::string(e.what()).find('\n'), std::string::npos) << e.what();
    if (code) *code = e.code();
    return e.what();
  }
  return "";
}

// `f` must fail with this code, in a line that contains the words.
inline void expect_error(const std::function<void()>& f, ExitCode wanted, const std::string& words) {
  ExitCode code{};
  const std::string line = error_of(f, &code);
  EXPECT_TRUE(!line.empty() && line.find(words) != std::string::npos) << "got: " << line << "\nwanted: " << words;
  EXPECT_EQ(code, wanted) << line;
}

}  // namespace pecs::tests

// Ends the test as skipped, with a message, when `relative` is not in shared/.
#define PECS_NEEDS_SHARED(relative)                                     \
  if (!std::filesystem::exists(pecs::tests::shared_dir() / (relative))) \
  GTEST_SKIP() << "needs " << (pecs::tests::shared_dir() / (relative)).string()
