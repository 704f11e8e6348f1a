#pragma once
// Every prescription that must work: those shipped, those of tests/lens/lenses, and those of shared/ where it is there.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <vector>

#include "pecs/lens/prescription.h"
#include "shared.h"

namespace pecs::lens::tests {

inline std::filesystem::path test_lens_dir() { return pecs::tests::source_dir() / "tests" / "lens" / "lenses"; }

inline std::vector<std::string> lens_files(bool shared = true) {
  std::vector<std::string> files;
  std::vector dirs{pecs::tests::source_dir() / "lens_data" / "lenses", test_lens_dir()};
  if (shared) dirs.push_back(pecs::tests::shared_dir() / "lenses");
  for (const auto& dir : dirs)
    if (std::filesystem::is_directory(dir))
      for (const auto& entry : std::filesystem::directory_iterator(dir))
        if (entry.path().extension() == ".json" && entry.path().filename().string()[0] != '_')
          files.push_back(entry.path().string());
  std::sort(files.begin(), files.end());
  return files;
}

// "lens_data/lenses/x.json" -> "lenses_x", for test names.
inline std::string test_name(const std::string& file) {
  const std::filesystem::path path(file);
  const std::string text = path.string();
  std::string name = (text.find("lens_data") != std::string::npos     ? "ours_"
                      : text.find("tests/lens/") != std::string::npos ? "test_"
                                                                      : "shared_") +
                     path.stem().string();
  std::replace_if(name.begin(), name.end(), [](unsigned char c) { return !std::isalnum(c); }, '_');
  return name;
}

struct EveryLens : testing::TestWithParam<std::string> {};

}  // namespace pecs::lens::tests

#define PECS_EVERY_LENS(suite)                                                                  \
  INSTANTIATE_TEST_SUITE_P(Lenses, suite, testing::ValuesIn(::pecs::lens::tests::lens_files()), \
                           [](const auto& param_info) { return ::pecs::lens::tests::test_name(param_info.param); })
#define PECS_SHIPPED_LENS(suite)                                                                     \
  INSTANTIATE_TEST_SUITE_P(Lenses, suite, testing::ValuesIn(::pecs::lens::tests::lens_files(false)), \
                           [](const auto& param_info) { return ::pecs::lens::tests::test_name(param_info.param); })
