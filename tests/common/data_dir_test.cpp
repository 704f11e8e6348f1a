#include "pecs/data_dir.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

#include "pecs/error.h"
#include "pecs/platform.h"
#include "shared.h"

namespace pecs {
namespace {

class DataDir : public testing::Test {
 protected:
  void SetUp() override {
    std::filesystem::create_directories(dir_ / "room/things");
    std::ofstream(dir_ / "room/things/one.json") << "{}";
    platform::set_environment("PECS_DATA", dir_.string());
  }
  void TearDown() override {
    platform::set_environment("PECS_DATA", "");
    std::filesystem::remove_all(dir_);
  }
  std::filesystem::path dir_ =
      std::filesystem::path(testing::TempDir()) / ("pecs_data_dir_" + std::to_string(::getpid()));
};

TEST_F(DataDir, FindsByName) { EXPECT_EQ(find_data("room/things", "one"), dir_ / "room/things/one.json"); }

TEST_F(DataDir, KeepsAPath) {
  EXPECT_EQ(find_data("room/things", "./two.json"), "./two.json");
  EXPECT_EQ(find_data("room/things", "two.json"), "two.json");
}

TEST_F(DataDir, UnknownNameListsTheAvailable) {
  pecs::tests::expect_error([] { find_data("room/things", "two"); }, ExitCode::not_found, "one");
}

TEST_F(DataDir, FindsTheCheckoutAboveTheProgram) {
  platform::set_environment("PECS_DATA", "");
  EXPECT_TRUE(std::filesystem::equivalent(data_dir("docs"), tests::source_dir() / "docs"));
  EXPECT_THROW(data_dir("no_such_room"), Error);
}

}  // namespace
}  // namespace pecs
